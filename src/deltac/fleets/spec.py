"""What a sweep is, as TOML or as arguments: validated at once, with messages that point at the line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    model_validator,
)

from deltac.diagnosis import RUN_TOLERANCE
from deltac.errors import InputError, SpecificationError, UnknownName, closest
from deltac.foreign.files import read_text
from deltac.foreign.limits import line_of, parse_toml


def _radians(value: Any) -> Any:
    """A number as it is; a text such as "30deg" in radians."""
    if isinstance(value, str) and value.strip().endswith("deg"):
        try:
            return math.radians(float(value.strip().removesuffix("deg")))
        except ValueError:
            return value
    return value


Number: TypeAlias = Annotated[
    float, BeforeValidator(_radians), Field(allow_inf_nan=False, strict=True)
]
Positive: TypeAlias = Annotated[float, Field(gt=0.0, allow_inf_nan=False, strict=True)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Range(_Strict):
    """An interval: `count` equidistant values of a grid, or what a random design draws from.

    `scale` "log" spaces or draws by the logarithm.
    """

    low: Number = Field(alias="from")
    high: Number = Field(alias="to")
    count: Annotated[int, Field(ge=1, strict=True)] | None = None
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ordered(self) -> Range:
        if not self.low < self.high and not (self.low == self.high and self.count == 1):
            raise ValueError(f"from = {self.low:g} is not below to = {self.high:g}")
        if self.scale == "log" and self.low <= 0.0:
            raise ValueError(f"from = {self.low:g}: a logarithmic range begins above zero")
        return self


def _kind(value: Any) -> str:
    return "range" if isinstance(value, Mapping | Range) else "values"


Axis: TypeAlias = Annotated[
    Annotated[Annotated[list[Number], Field(min_length=1)], Tag("values")]
    | Annotated[Range, Tag("range")],
    Discriminator(_kind),
]
"""Values, or an interval."""

Names: TypeAlias = Annotated[list[str], Field(min_length=1)]


class VariedAxis(_Strict):
    """What differs between runs: settings by name, parameters and initial states by axes."""

    model: Names | None = None
    solver: Names | None = None
    step: Annotated[list[Positive], Field(min_length=1)] | None = None
    solver_tolerance: Annotated[list[Positive], Field(min_length=1)] | None = None
    duration: Annotated[list[Positive], Field(min_length=1)] | None = None
    parameter: dict[str, Axis] = {}
    q: dict[str, Axis] = {}
    u: dict[str, Axis] = {}


class DesignSpec(_Strict):
    """How points are laid: every combination, value by value, or at random.

    `file`: a table (CSV or Parquet) with the points of a list, a column for each axis.
    """

    kind: Literal["grid", "list", "latin-hypercube", "sobol"] = "grid"
    points: Annotated[int, Field(ge=1, strict=True)] | None = None
    seed: Annotated[int, Field(ge=0, strict=True)] = 0
    file: str | None = None


class Execution(_Strict):
    """How the work is done; nothing here changes a result.

    `time_limit`: seconds that a piece of work may take; `retries`: how often a single run is tried again
    whose worker died or took too long; `chunk`: runs in a piece.
    """

    workers: Annotated[int, Field(ge=1, strict=True)] | None = None
    time_limit: Positive = 600.0
    retries: Annotated[int, Field(ge=0, strict=True)] = 2
    chunk: Annotated[int, Field(ge=1, strict=True)] | None = None
    scheduler: str | None = None

    def overridden(self, **options: Any) -> Execution:
        """The same, but for what is given and not None; InputError for what is no such value."""
        asked = {name: value for name, value in options.items() if value is not None}
        try:
            return Execution.model_validate({**self.model_dump(), **asked})
        except ValidationError as error:
            (one, *_) = error.errors(include_url=False)
            name = ".".join(map(str, one["loc"]))
            raise SpecificationError(f"{name}: {_words(one)}, found {one['input']!r:.60}") from None


class SweepSpec(_Strict):
    """A sweep.

    `tolerance`: accepted energy error as a fraction of the energy that the system has; `solver_tolerance`:
    that of solvers which choose their steps.
    """

    name: str = ""
    verb: Literal["simulate", "study"] = "simulate"
    model: str | None = None
    state: str | None = None
    solver: str | None = None
    step: Positive | None = None
    solver_tolerance: Positive | None = None
    duration: Positive | None = None
    tolerance: Annotated[float, Field(gt=0.0, lt=1.0, strict=True)] = RUN_TOLERANCE
    parameter: dict[str, Number] = {}
    q: dict[str, Number] = {}
    u: dict[str, Number] = {}
    vary: VariedAxis = VariedAxis()
    design: DesignSpec = DesignSpec()
    execution: Execution = Execution()


def read_spec(path: str | Path) -> SweepSpec:
    """The sweep that a TOML file describes; InputError names the line of what is wrong."""
    source = Path(path)
    try:
        text = read_text(source)
        document = parse_toml(text)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    spec = _validated(
        document, lambda place: f"{source}, line {line_of(text, _dotted(place)) or 1}"
    )
    spec = spec if spec.name else spec.model_copy(update={"name": source.stem})
    if spec.design.file is None:
        return spec
    table = str(source.parent / spec.design.file)
    return spec.model_copy(update={"design": spec.design.model_copy(update={"file": table})})


def make_spec(values: Mapping[str, Any]) -> SweepSpec:
    """The sweep that values by name describe; InputError names the key."""
    return _validated(dict(values), lambda place: _dotted(place) or "sweep")


def _validated(document: dict[str, Any], where: Any) -> SweepSpec:
    try:
        return SweepSpec.model_validate(document)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    messages = []
    unknown = False
    for one in errors[:5]:
        place = _within(document, one["loc"])
        if one["type"] == "extra_forbidden":
            unknown = True
            names = list(_fields(one["loc"][:-1]))
            messages.append(
                f"{where(place)}: unknown key {place[-1]!r}{closest(str(place[-1]), names)}"
            )
        elif one["type"] == "missing":
            name = one["loc"][-1]
            messages.append(f"{where(place)}: {_dotted(place)} lacks {name!r}")
        else:
            messages.append(
                f"{where(place)}: {_dotted(place)}: {_words(one)}, found {one['input']!r:.60}"
            )
    more = f"; and {len(errors) - 5} more" if len(errors) > 5 else ""
    kind = UnknownName if unknown and len(errors) == 1 else InputError
    raise kind("; ".join(messages) + more)


def _words(error: Any) -> str:
    """What pydantic expected, as we would say it."""
    text = str(error["msg"]).removeprefix("Value error, ").replace("Input should be", "expected")
    return text[:1].lower() + text[1:]


def _fields(place: Sequence[int | str]) -> Iterator[str]:
    """Names of the keys that may stand at a place."""
    model: type[BaseModel] = SweepSpec
    for part in place:
        field = model.model_fields.get(str(part))
        if field is None:  # an axis by its name, or the tag of a union
            model = Range
            continue
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            model = inner
        elif any(isinstance(a, type) for a in get_args(inner)):
            model = Range
    for name, field in model.model_fields.items():
        yield field.alias or name


def _within(document: Any, place: Sequence[int | str]) -> tuple[int | str, ...]:
    """The part of a place that is in the document: pydantic adds tags of unions, and what is missing."""
    path: list[int | str] = []
    entry: Any = document
    for part in place:
        if isinstance(entry, Mapping):
            inside = part in entry
        else:
            inside = isinstance(entry, list) and isinstance(part, int) and part < len(entry)
        if inside:
            entry = entry[part]
            path.append(part)
    return tuple(path)


def _dotted(place: Sequence[int | str]) -> str:
    return ".".join(map(str, place))
