"""A user's own system: a class in a Python file that lies next to the problem file, run only with consent."""

from __future__ import annotations

import importlib.util
import sys
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from typing import Any

from ensemble_ctrl.files.config.errors import FieldError, show, suggestion
from ensemble_ctrl.files.config.source import read_bytes, text_of
from ensemble_ctrl.files.config.tree import TextError, Tree
from ensemble_ctrl.systems import SYSTEMS, System

CONSENT: ContextVar[bool] = ContextVar("CONSENT", default=False)
"""Whether Python files next to problem files may be run without a confirmation for each; the command's ``--trust``."""
EXAMPLE = "for example  model: {python: my_system.py:MySystem}"
BY_ODE = [name for name, system in SYSTEMS.items() if not system.on_arcs]
"""The models whose fleet section names states, settings and parameters as the system does."""


def by_ode(data: Any) -> bool:
    """Whether a problem file's data are about a model of `BY_ODE`, or a user's own."""
    fleet = data.get("fleet") if isinstance(data, dict) else None
    model = fleet.get("model") if isinstance(fleet, dict) else None
    known = SYSTEMS.get(model) if isinstance(model, str) else None
    return isinstance(model, dict) or (known is not None and not known.on_arcs)


def named_source(path: Path) -> str | None:
    """The name of the Python file that a problem file names as its model; None if it names none, or can't be read."""
    try:
        data = Tree.read(text_of(read_bytes(path))).data
    except TextError:
        return None
    model = data["fleet"]["model"] if by_ode(data) else None
    value = model.get("python") if isinstance(model, dict) else None
    return value.rpartition(":")[0] if isinstance(value, str) else None


def system_class(value: Any, context: dict[str, Any] | None) -> type[System]:
    """The class that ``fleet.model`` names.

    Parameters
    ----------
    value : str or mapping
        A model's name, or ``{python: FILE.py:CLASS}``.
    context : dict
        ``folder`` of the problem file, and whether to ``trust`` files next to it.

    Raises
    ------
    FieldError
        If there is no such class, or its file may not be run.
    """
    if isinstance(value, type) and issubclass(value, System):
        return value
    if not isinstance(value, dict):
        if value not in SYSTEMS:
            raise FieldError(f"{show(value)} is not one of {', '.join(SYSTEMS)}", suggestion(value, SYSTEMS))
        return SYSTEMS[value]
    if set(value) != {"python"} or not isinstance(value["python"], str):
        raise FieldError(f"expected a model's name or {{python: FILE.py:CLASS}}, got {show(value)}", EXAMPLE)
    name, _, kind = value["python"].rpartition(":")
    if not name.endswith(".py") or not kind.isidentifier():
        raise FieldError(f"expected FILE.py:CLASS, got {show(value['python'])}", EXAMPLE, ("python",))
    if not ((context or {}).get("trust", False) or CONSENT.get()):
        hint = "it is a program: read it, then add --trust to the command, or trust=True to ec.load"
        raise FieldError(f"expected your consent to run {name}", hint, ("python",))
    return _class(_beside(name, Path((context or {}).get("folder", Path()))), kind)


def _beside(name: str, folder: Path) -> Path:
    """A file that lies in the problem file's own folder, not elsewhere by a path or a link."""
    path = folder / name
    if Path(name).name != name or path.resolve().parent != folder.resolve():
        raise FieldError(f"expected a file next to the problem file, got {show(name)}", "copy it there", ("python",))
    if not path.is_file():
        raise FieldError(f"{name}: no such file next to the problem file", path=("python",))
    return path.resolve()


def _class(path: Path, kind: str) -> type[System]:
    """A class of a file."""
    status = path.stat()
    found = getattr(_module(path, status.st_mtime_ns, status.st_size), kind, None)
    if not (isinstance(found, type) and issubclass(found, System)):
        got = "a class that is none" if isinstance(found, type) else type(found).__name__
        came = "there is no such name" if found is None else f"got {got}"
        raise FieldError(f"{path.name}: expected a child of OdeSystem called {kind}, {came}", path=("python",))
    return found


@lru_cache(maxsize=32)
def _module(path: Path, changed: int, size: int) -> Any:
    """The file, run once for each of its versions."""
    name = f"ensemble_ctrl_own_{path.stem}_{abs(hash((path, changed, size))):x}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise FieldError(f"{path.name}: can't be run", path=("python",))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        line = getattr(error, "lineno", None)
        trace, last = error.__traceback__, None
        while trace is not None:
            last = trace.tb_lineno if trace.tb_frame.f_code.co_filename == str(path) else last
            trace = trace.tb_next
        where = f", line {line or last}" if line or last else ""
        raise FieldError(f"{path.name}{where}: {type(error).__name__}: {error}", path=("python",)) from None
    return module
