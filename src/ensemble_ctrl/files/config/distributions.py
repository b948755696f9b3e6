"""The distribution of a parameter in a problem file: read, built, and written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import inf
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, cast

from pydantic import AfterValidator, BeforeValidator, PrivateAttr, ValidationInfo, WithJsonSchema, model_validator

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.errors import FieldError, show, suggestion
from ensemble_ctrl.files.config.samples import Columns, Values, columns_of, samples
from ensemble_ctrl.moments import DISTRIBUTIONS, Distribution, Mixture, Samples
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.checks import Finding

Data = dict[str, Any]
Place = tuple[str | int, ...]

SHAPES: dict[str, dict[str, str]] = {
    "uniform": {},
    "beta": {"a": "a: 2", "b": "b: 5"},
    "normal": {"mean": "mean: 1.0", "deviation": "deviation: 0.03"},
}
"""Numbers that the distributions of this package take, with examples."""


def _distribution_name(value: str) -> str:
    """The name of a distribution over a range."""
    if value not in DISTRIBUTIONS:
        raise FieldError(f"{show(value)} is not one of {', '.join(DISTRIBUTIONS)}", suggestion(value, DISTRIBUTIONS))
    return value


DistributionName = Annotated[str, AfterValidator(_distribution_name), WithJsonSchema({"enum": list(DISTRIBUTIONS)})]


def _values(kind: str) -> WithJsonSchema:
    """The JSON Schema of measured values: a file's name, or a list of numbers that may carry a unit of `kind`."""
    items = f.numeric(kind).json_schema
    return WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "array", "items": items, "minItems": 1}]})


Measured = Annotated[Values | str, BeforeValidator(samples), _values("number")]
Lengths = Annotated[Values | str, BeforeValidator(lambda value: samples(value, quantity("length"))), _values("length")]
Angles = Annotated[Values | str, BeforeValidator(lambda value: samples(value, quantity("angle"))), _values("angle")]


class PartSection(f.Model):
    """How a parameter is spread: a distribution over a range, or measured values."""

    range: f.Range = (0.9, 1.1)
    """Low and high end, `[low, high]`."""
    distribution: DistributionName = "uniform"
    """How it is spread over the range."""
    a: f.Number | None = None
    """Shape of a Beta distribution at the low end."""
    b: f.Number | None = None
    """Shape of a Beta distribution at the high end."""
    mean: f.Number | None = None
    """Mean of a normal distribution, before it is cut off at the range's ends."""
    deviation: f.Number | None = None
    """Standard deviation of a normal distribution, before it is cut off."""
    numbers: dict[str, f.Number] | None = None
    """Numbers of a distribution that was added to `ensemble_ctrl.moments.DISTRIBUTIONS`, by name."""
    samples: Measured | None = None
    """Measured values, or the name of a CSV file of them, in place of a range."""
    _columns: Columns = PrivateAttr(default_factory=dict)
    _above: ClassVar[float] = 0.0

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        """Read the file, and build the distribution, so that what is wrong is reported with everything else."""
        if self.samples is not None:
            _alone(self, "samples")
            self._columns = self._measured((info.context or {}).get("folder", Path()))
            return self
        _complete(self)
        try:
            self.over_range()
        except ProblemError as error:
            name, _, message = str(error).partition(": ")
            path = (name,) if name in type(self).model_fields else ("numbers", name)
            raise FieldError(message, path=path) from None
        return self

    def _measured(self, folder: Path) -> Columns:
        """The columns of measured values."""
        if not isinstance(self.samples, str):
            return {"": self.samples or ()}
        try:
            return columns_of(folder, self.samples, self._above)
        except FieldError as error:
            raise FieldError(error.message, error.hint, ("samples",)) from None

    def over_range(self) -> Distribution:
        """The distribution over the range."""
        make: Callable[..., Distribution] = DISTRIBUTIONS[self.distribution]
        return make(*self.range, *(_number(self, name) for name in DISTRIBUTIONS[self.distribution].numbers))


class MixturePart(PartSection):
    """One distribution of a mixture."""

    weight: f.Positive = 1.0
    """Share of this distribution, relative to the others."""


class DistributionSection(PartSection):
    """How a parameter is spread over the fleet: a distribution over a range, a mixture, or measured values."""

    mixture: list[MixturePart] | None = None
    """A list of distributions, each with a `weight`, in place of a range."""

    @model_validator(mode="after")
    def _check_mixture(self) -> Self:
        """A mixture has parts, and nothing beside it."""
        _check_mixture(self)
        return self


class OffsetPart(PartSection):
    """How an offset of the start position is spread."""

    range: f.Offsets = (0.0, 0.0)
    """Low and high end of the offset, `[low, high]`."""
    mean: f.Length | None = None
    deviation: f.Length | None = None
    samples: Lengths | None = None
    _above: ClassVar[float] = -inf


class OffsetMixturePart(OffsetPart):
    """One distribution of a mixture."""

    weight: f.Positive = 1.0
    """Share of this distribution, relative to the others."""


class OffsetSection(OffsetPart):
    """How an offset of the start position is spread over the fleet."""

    mixture: list[OffsetMixturePart] | None = None
    """A list of distributions, each with a `weight`, in place of a range."""

    @model_validator(mode="after")
    def _check_mixture(self) -> Self:
        """A mixture has parts, and nothing beside it; a distribution has a range."""
        _check_range(self)
        _check_mixture(self)
        return self


class TurnPart(PartSection):
    """How an offset of the start heading is spread."""

    range: f.AngleRange = (0.0, 0.0)
    """Low and high end of the offset, `[low, high]`."""
    mean: f.Angle | None = None
    deviation: f.Angle | None = None
    samples: Angles | None = None
    _above: ClassVar[float] = -inf


class TurnMixturePart(TurnPart):
    """One distribution of a mixture."""

    weight: f.Positive = 1.0
    """Share of this distribution, relative to the others."""


class TurnSection(TurnPart):
    """How an offset of the start heading is spread over the fleet."""

    mixture: list[TurnMixturePart] | None = None
    """A list of distributions, each with a `weight`, in place of a range."""

    @model_validator(mode="after")
    def _check_mixture(self) -> Self:
        """A mixture has parts, and nothing beside it; a distribution has a range."""
        _check_range(self)
        _check_mixture(self)
        return self


class PlainPart(PartSection):
    """How a parameter of any sign, in its own unit, is spread."""

    range: f.AnyRange = (0.0, 0.0)
    """Smallest and largest value, in the parameter's own unit."""
    _above: ClassVar[float] = -inf


class PlainMixturePart(PlainPart):
    """One distribution of a mixture."""

    weight: f.Positive = 1.0
    """Share of the fleet, relative to the other parts."""


class PlainSection(PlainPart):
    """How a parameter of a system that is no robot on arcs is spread over the fleet."""

    mixture: list[PlainMixturePart] | None = None
    """A list of distributions, each with a `weight`, in place of a range."""

    @model_validator(mode="after")
    def _check_mixture(self) -> Self:
        """A mixture has parts, and nothing beside it; a distribution has a range."""
        _check_range(self)
        _check_mixture(self)
        return self


AnySection = DistributionSection | OffsetSection | TurnSection | PlainSection
AnyPart = MixturePart | OffsetMixturePart | TurnMixturePart | PlainMixturePart


def _check_mixture(section: AnySection) -> None:
    """A mixture has parts, and nothing beside it."""
    if section.mixture is not None:
        _alone(section, "mixture")
        if not section.mixture:
            raise FieldError("expected at least one distribution, got an empty list", path=("mixture",))


def _check_range(section: AnySection) -> None:
    """An offset has no range that goes without saying."""
    if section.samples is None and section.mixture is None and "range" not in section.model_fields_set:
        raise FieldError("expected a range, samples or a mixture, got none", "for example  {range: [-0.1, 0.1]}")


def distribution_of(section: AnySection, name: str) -> Distribution:
    """The distribution of the parameter called `name`.

    Raises
    ------
    ProblemError
        If a table of measured values has several columns and none of this name; with a finding.
    """
    path: Place = ("fleet", "parameters", name)
    if section.mixture is None:
        return _part(section, name, path)
    parts: list[AnyPart] = [*section.mixture]
    return Mixture(*((_part(part, name, (*path, "mixture", i)), part.weight) for i, part in enumerate(parts)))


def distribution_data(distribution: Distribution) -> Data:
    """A distribution as it stands in a problem file, with measured values in place of the name of their file."""
    if isinstance(distribution, Mixture):
        return {"mixture": [_part_data(part) | {"weight": weight} for part, weight in _flat(distribution)]}
    return _part_data(distribution)


def _part(section: PartSection, name: str, path: Place) -> Distribution:
    """One distribution that is no mixture."""
    if section.samples is None:
        return section.over_range()
    columns = section._columns
    if len(columns) == 1:
        return Samples(next(iter(columns.values())))
    if name not in columns:
        message = f"{section.samples}: expected a column {name!r}, got {', '.join(columns)}"
        refusal = ProblemError(message)
        refusal.findings = (Finding((*path, "samples"), message, suggestion(name, columns)),)
        raise refusal
    return Samples(columns[name])


def _part_data(distribution: Distribution) -> Data:
    """One distribution that is no mixture, as data."""
    if isinstance(distribution, Samples):
        return {"samples": distribution.values.tolist()}
    kind = next((name for name, made in DISTRIBUTIONS.items() if type(distribution) is made), None)
    if kind is None:
        raise ProblemError(
            f"fleet.parameter: expected a distribution that a problem file can hold, got {distribution!r}"
        )
    numbers = {name: getattr(distribution, name) for name in distribution.numbers}
    named = {name: value for name, value in numbers.items() if name in PartSection.model_fields}
    added = {name: value for name, value in numbers.items() if name not in named}
    data: Data = {"range": [distribution.lower, distribution.upper]} | (
        {} if kind == "uniform" else {"distribution": kind}
    )
    return data | named | ({"numbers": added} if added else {})


def _flat(distribution: Mixture, weight: float | None = None) -> Iterator[tuple[Distribution, float]]:
    """Parts of a mixture, those of mixtures in it included; `weight` is that of the whole."""
    total = sum(own for _, own in distribution.parts)
    for part, own in distribution.parts:
        share = own if weight is None else weight * (own / total)
        if isinstance(part, Mixture):
            yield from _flat(part, share)
        else:
            yield part, share


def _number(section: PartSection, name: str) -> float | None:
    """A number of the section's distribution: a field of its own, or one of `numbers`."""
    if name in type(section).model_fields:
        return cast("float | None", getattr(section, name))
    return (section.numbers or {}).get(name)


def _complete(section: PartSection) -> None:
    """A distribution has its numbers, and no others."""
    takes = DISTRIBUTIONS[section.distribution].numbers
    for name in takes:
        if _number(section, name) is None:
            message = f"expected {' and '.join(takes)} for {section.distribution}, but {name} is missing"
            example = SHAPES.get(section.distribution, {}).get(name, f"numbers: {{{name}: 1.0}}")
            raise FieldError(message, f"for example  {example}", ("distribution",))
    for name in section.numbers or {}:
        if name not in takes or name in type(section).model_fields:
            raise FieldError(f"expected no {name} in numbers for {section.distribution}", path=("numbers", name))
    for distribution, names in SHAPES.items():
        for name in names:
            if name not in takes and getattr(section, name) is not None:
                raise FieldError(
                    f"expected no {name} for {section.distribution}",
                    f"{name} is for distribution: {distribution}",
                    (name,),
                )


def _alone(section: PartSection, form: str) -> None:
    """Nothing stands beside measured values, or beside a mixture."""
    others = [name for name in type(section).model_fields if name in section.model_fields_set - {form, "weight"}]
    if others:
        raise FieldError(f"expected {form} without {' and '.join(others)}", "leave one of them out", (others[0],))
