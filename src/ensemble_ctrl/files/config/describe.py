"""What the fields of a problem file mean: the text below each field of its model, read when it is needed."""

from __future__ import annotations

import ast
import inspect
from functools import cache
from itertools import pairwise
from textwrap import dedent
from typing import Any

from ensemble_ctrl.files.config.fields import Model
from ensemble_ctrl.files.config.schema import ProblemFile

IDENTITY = "urn:ensemble-ctrl:problem-file:1"
"""What this schema is the schema of, with the version of the format; no address to fetch it from."""

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema() -> dict[str, Any]:
    """The JSON Schema of a problem file, for editors: every field with its type, its default and what it means."""
    described = ProblemFile.model_json_schema()
    obstacles = described["properties"]["obstacles"]
    listed = obstacles["additionalProperties"]
    obstacles["additionalProperties"] = {"anyOf": [listed["items"], listed]}
    models = {model.__name__: model for model in _all(Model)}
    for name, section in {ProblemFile.__name__: described, **described["$defs"]}.items():
        _explain(section, models[name])
    return {"$schema": DIALECT, "$id": IDENTITY, **described, "title": "A problem file of ensemble_ctrl"}


def meanings(model: type[Model]) -> dict[str, str]:
    """The text below each field of a model, those of the models that it extends included."""
    found: dict[str, str] = {}
    for parent in reversed(model.__mro__):
        if issubclass(parent, Model) and parent is not Model:
            found |= _own(parent)
    return found


@cache
def _own(model: type[Model]) -> dict[str, str]:
    """The texts in the body of one class."""
    (body,) = (node.body for node in ast.parse(dedent(inspect.getsource(model))).body if isinstance(node, ast.ClassDef))
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


def _explain(section: dict[str, Any], model: type[Model]) -> None:
    """Describe each field; titles that repeat its name, and defaults that are nothing, are left out."""
    texts = meanings(model)
    for name, described in section["properties"].items():
        described.pop("title", None)
        if described.get("default", 0) is None or isinstance(described.get("default"), dict):
            del described["default"]
        if name in texts:
            described["description"] = texts[name]


def _all(model: type[Model]) -> set[type[Model]]:
    """A model and all that extend it."""
    return {model}.union(*map(_all, model.__subclasses__()))
