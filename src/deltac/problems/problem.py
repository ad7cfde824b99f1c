"""A published problem: what moves, how it starts, what must stay constant, what must come out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, get_args

from deltac.errors import InputError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State

if TYPE_CHECKING:
    from deltac.problems.measures import Measure, Signal
    from deltac.simulation.equations import Equations

Kind = Literal["exact", "published", "calculated"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """A number that a right simulation must reproduce.

    quantity  what it is, for people: "θ(1 s)"
    value     its value, in `unit`
    kind      "exact" (a closed form), "published" (in the literature), or "calculated" (once, at
              high accuracy, by two independent routes)
    accuracy  how well the value itself is known: an absolute bound in `unit`
    at        the time it belongs to (s), None if it describes the whole motion
    measure   takes it from a trajectory; the trajectory must have a row at that time
    """

    quantity: str
    value: float
    unit: str
    kind: Kind
    accuracy: float
    measure: Measure
    at: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise InputError(
                f"reference {self.quantity!r}: kind is {self.kind!r}, expected one of "
                f"{', '.join(get_args(Kind))}"
            )
        if not (math.isfinite(self.value) and math.isfinite(self.accuracy) and self.accuracy >= 0):
            raise InputError(
                f"reference {self.quantity!r}: value {self.value!r} ± {self.accuracy!r}; expected "
                "finite numbers, the accuracy zero or positive"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A problem of the library.

    name, title     what `load` knows it by; what it is, in a few words
    mechanism       what the machine is
    state           where the motion starts
    duration        how long it lasts (s)
    step, solver    a fixed step (s) and a solver that resolve the reference numbers; the step of an
                    adaptive solver is the spacing of its samples
    tolerance       relative, of an adaptive solver
    source          who published it
    freedom         degrees of freedom: independent speeds (without constraints, those that are free)
    invariants      name -> the constant quantity (T,) along a trajectory, written out by hand;
                    "energy" is always K + V, with V measured from the ground's origin
    reference       the numbers that must come out
    equations       equations of motion written by hand, where the source has them
    coordinates     the source's own generalized speeds for the testing functions, if they matter
    notes           what is worth knowing

    Raises InputError for impossible times, references outside the duration, and constraints without
    a word on the freedom that they leave.
    """

    name: str
    title: str
    mechanism: Mechanism
    state: State
    duration: float
    step: float
    solver: str
    source: str
    freedom: int | None = None
    invariants: Mapping[str, Signal] = field(default_factory=dict)
    reference: tuple[Reference, ...] = ()
    equations: Equations | None = None
    coordinates: CoordinateMap | None = None
    notes: str = ""
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.step <= self.duration < math.inf:
            raise InputError(
                f"problem {self.name!r}: step {self.step!r} s and duration {self.duration!r} s; "
                "expected 0 < step <= duration"
            )
        if self.freedom is None:
            if self.mechanism.constraints:
                raise InputError(
                    f"problem {self.name!r} has constraints; say how many degrees of freedom they "
                    "leave: freedom="
                )
            object.__setattr__(self, "freedom", len(self.mechanism.free.u))
        for reference in self.reference:
            if reference.at is not None and not 0.0 <= reference.at - self.state.t <= self.duration:
                raise InputError(
                    f"problem {self.name!r}: {reference.quantity} belongs to t = {reference.at} s, "
                    f"outside the duration of {self.duration} s"
                )

    @property
    def conserved(self) -> tuple[str, ...]:
        """The names of what stays constant."""
        return tuple(self.invariants)
