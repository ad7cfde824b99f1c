"""Parts of a mechanism, and what their fields may hold.

A part is a frozen dataclass. Each field is annotated with the kind of thing that it holds, such as
``damping: NonNegative``. The kind reads what a user wrote when the part is made, and checks names, symbols
and signs when the part joins a mechanism. A part adds only what concerns several of its fields.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeAlias,
    get_args,
    get_origin,
    get_type_hints,
)

from deltac.calls.arguments import Target, checked
from deltac.errors import ModelError, UnknownName, closest, shown
from deltac.mechanism.laws import as_law
from deltac.mechanism.quantities import as_rotation, part_name, positive, unit_vector, vector
from deltac.mechanism.scope import Scope, require_name


def constructor(target: Target, options: Callable[..., Any] | None = None) -> Target:
    """The decorator of functions and classes that make parts: see `checked`.

    Users call a class by the name of a function, ``forces.joint_damper`` for `JointDamper`.
    """
    return checked(target, options, re.sub(r"(?<!^)([A-Z])", r"_\1", target.__name__).lower())


# --- kinds of fields ------------------------------------------------------------------------------


@dataclass(frozen=True)
class FieldKind:
    """How the value of a field is read, and what it is checked for; messages begin with the field.

    read     (value, where) -> what the field holds
    symbols  what its laws may depend on: the name of a property of `Scope`, from "constants" to "in_motion"
    sign     "positive" or "not negative", as far as it is constant
    body     it names a body: "any", or "moving" for all but the ground
    """

    read: Callable[[Any, str], Any] | None = None
    symbols: str = ""
    sign: Literal["", "positive", "not negative"] = ""
    body: Literal["", "any", "moving"] = ""

    def check(self, scope: Scope, value: Any, where: str) -> None:
        """InputError for unknown bodies and symbols, and a wrong sign."""
        if self.body:
            scope.body(value, where, ground=self.body == "any")
        laws = value if isinstance(value, tuple) else (value,)
        if self.symbols:
            scope.laws(laws, getattr(scope, self.symbols), where)
        if self.sign:
            for law in filter(scope.is_constant, laws):
                scope.positive(law, where, allow_zero=self.sign == "not negative")


def _not_negative(value: Any, where: str) -> Any:
    return positive(value, where, allow_zero=True)


def each(value: Any, where: str) -> tuple[Any, ...]:
    """A law, or several, as a tuple."""
    values = value if isinstance(value, list | tuple) else (value,)
    return tuple(as_law(entry, where) for entry in values)


def _each_not_negative(value: Any, where: str) -> tuple[Any, ...]:
    return tuple(_not_negative(entry, where) for entry in each(value, where))


Constant: TypeAlias = Annotated[Any, FieldKind(as_law, "constants")]
"""A number, or an expression in parameters."""

Constants: TypeAlias = Annotated[Any, FieldKind(each, "constants")]
"""One of them or several; a tuple."""

Positive: TypeAlias = Annotated[Any, FieldKind(positive, "constants", "positive")]
NonNegative: TypeAlias = Annotated[Any, FieldKind(_not_negative, "constants", "not negative")]
NonNegatives: TypeAlias = Annotated[Any, FieldKind(_each_not_negative, "constants", "not negative")]

Law: TypeAlias = Annotated[Any, FieldKind(as_law)]
"""A law whose symbols its part checks."""

LawOfTime: TypeAlias = Annotated[Any, FieldKind(as_law, "in_time")]
PositiveOfTime: TypeAlias = Annotated[Any, FieldKind(positive, "in_time", "positive")]
NonNegativeOfTime: TypeAlias = Annotated[Any, FieldKind(_not_negative, "in_time", "not negative")]
LawsOfTime: TypeAlias = Annotated[Any, FieldKind(each, "in_time")]

LawOfPlace: TypeAlias = Annotated[Any, FieldKind(as_law, "in_place")]
"""A law of t and q."""

LawOfMotion: TypeAlias = Annotated[Any, FieldKind(as_law, "in_motion")]
LawsOfMotion: TypeAlias = Annotated[Any, FieldKind(each, "in_motion")]
"""Laws of t, q and u."""

Point: TypeAlias = Annotated[Any, FieldKind(vector, "constants")]
"""Three components in the frame of a body."""

PointOfTime: TypeAlias = Annotated[Any, FieldKind(vector, "in_time")]
VectorOfMotion: TypeAlias = Annotated[Any, FieldKind(vector, "in_motion")]

VectorInField: TypeAlias = Annotated[Any, FieldKind(vector, "in_field")]
"""Three laws of t, q, u, and of the place x, y, z and the velocity vx, vy, vz of a point."""

Axis: TypeAlias = Annotated[Any, FieldKind(unit_vector)]
"""A direction: "x", "-z", … or three numbers; it becomes a unit vector."""

Rotation: TypeAlias = Annotated[Any, FieldKind(as_rotation)]


def _name_of(what: str) -> Callable[[Any, str], str]:
    def read(value: Any, where: str) -> str:
        require_name(value, what, where)
        return str(value)

    return read


JointName: TypeAlias = Annotated[str, FieldKind(_name_of("joint"))]

AnyBody: TypeAlias = Annotated[str, FieldKind(_name_of("body"), body="any")]
"""The name of a body, or "ground"."""

MovingBody: TypeAlias = Annotated[str, FieldKind(_name_of("body"), body="moving")]


def _choice(options: Sequence[str]) -> FieldKind:
    def read(value: Any, where: str) -> Any:
        if value not in options:
            choices = " or ".join(map(repr, options))
            hint = closest(str(value), options)
            hint = hint if "did you mean" in hint else ""
            raise UnknownName(f"{where}: found {shown(value)}, expected {choices}{hint}")
        return value

    return FieldKind(read)


@cache
def kinds_of(part: type[Any]) -> dict[str, FieldKind]:
    """The kinds of a part's fields, by name; fields of other types have none."""
    kinds = {}
    for name, hint in get_type_hints(part, include_extras=True).items():
        if get_origin(hint) is Literal:
            kinds[name] = _choice(get_args(hint))
        for kind in get_args(hint):
            if isinstance(kind, FieldKind):
                kinds[name] = kind
    return {field.name: kinds[field.name] for field in fields(part) if field.name in kinds}


# --- parts ----------------------------------------------------------------------------------------


class Declared:
    """A frozen dataclass whose fields are read and checked by their kinds.

    None stays None in a field whose default it is.
    """

    @property
    def where(self) -> str:
        """What messages call it."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        """Read every field."""
        where = self.where
        for name, kind in self._kinds.items():
            value = getattr(self, name)
            if kind.read and not self._absent(name):
                read = kind.read(value, f"{_words(name)} of {where}")
                object.__setattr__(self, name, read)

    def check_fields(self, scope: Scope, where: str) -> None:
        """InputError unless every field fits the mechanism; `where` is how messages call the whole."""
        for name, kind in self._kinds.items():
            if not self._absent(name):
                kind.check(scope, getattr(self, name), f"{_words(name)} of {where}")

    @property
    def _kinds(self) -> dict[str, FieldKind]:
        cls: Any = type(self)
        return kinds_of(cls)

    def _absent(self, name: str) -> bool:
        return getattr(self, name) is None and getattr(type(self), name, 0) is None


def _words(name: str) -> str:
    return name.replace("_", " ")


class Part(Declared):
    """A named part of a mechanism: a frozen dataclass that checks itself against a scope.

    `noun` is what messages call it. `channel_kinds` are the kinds of the channels through which its energy
    flows; a channel is named "<kind> <part>", and no two parts may share one.
    """

    noun: ClassVar[str]
    name: str

    def __post_init__(self) -> None:
        """Read the name, then every field."""
        self.called(self.name)
        super().__post_init__()

    @classmethod
    def called(cls, name: object) -> str:
        """The part of that name, for messages; InputError unless it is a name."""
        article = "an" if cls.noun[0] in "aeiou" else "a"
        return f"{cls.noun} {part_name(name, f'{article} {cls.noun}')!r}"

    @property
    def where(self) -> str:
        """The part, as messages call it: ``joint damper 'elbow'``."""
        return f"{self.noun} {self.name!r}"

    @property
    def channel_kinds(self) -> tuple[str, ...]:
        """Kinds of the channels that it feeds; none by default."""
        return ()

    def check(self, scope: Scope) -> None:
        """InputError unless the part fits the mechanism."""
        self.check_fields(scope, self.where)


def require_count(values: Sequence[Any], expected: int, where: str) -> None:
    """InputError unless there are as many values as expected."""
    if len(values) != expected:
        raise ModelError(f"{where}: expected {expected} values, found {len(values)}")


def require_apart(first: str, second: str, where: str) -> None:
    """InputError for a part between a body and itself."""
    if first == second:
        raise ModelError(f"{where} connects body {first!r} with itself, so it does nothing")
