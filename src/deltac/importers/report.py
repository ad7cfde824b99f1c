"""What an import took over from a file, what it left out, and what it took for granted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from deltac.mechanism import Constraint, Element, State
from deltac.results import SHOWN


@dataclass(frozen=True)
class Remark:
    """One thing about one element: what it is, and what that means for an audit.

    `limits`: least and largest coordinate of a joint beyond which its force acts.
    """

    element: str
    what: str
    consequence: str = ""
    limits: tuple[float, float] | None = None

    @staticmethod
    def logged(
        element: str,
        what: str,
        channel: str,
        limits: tuple[float, float] | None = None,
        alias: str = "",
    ) -> Remark:
        """Of a force that has no counterpart here: the channel that a log supplies it in, or its `alias`."""
        remedy = f"its force must come from the log: channel '{channel}'"
        remedy += f" or '{alias}'" if alias else ""
        return Remark(element, what, remedy, limits)

    def __str__(self) -> str:
        text = f"{self.element}: {self.what}"
        return f"{text} → {self.consequence}" if self.consequence else text


@dataclass(frozen=True)
class ImportReport:
    """What an import `read`, what has no counterpart here (`ignored`), and what it `assumed`.

    Everything in `ignored` that does work must come from the log, in the channel that its consequence
    names, or it will show as an energy error.

    `equalities`: those of `ignored` equalities that have a counterpart, as the exact constraints that
    they would be; `strengths`: of simple motors, force per unit of control (see `motor_strengths`);
    `servo_damping`: damping in the laws of servos by speed, N·s/m or N·m·s/rad;
    `starts`: the states of the model's keyframes by their names, then MuJoCo's reference, "qpos0".
    """

    source: str
    read: tuple[Remark, ...] = ()
    ignored: tuple[Remark, ...] = ()
    assumed: tuple[Remark, ...] = ()
    equalities: tuple[Constraint, ...] = ()
    strengths: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    servo_damping: Mapping[str, float] = field(default_factory=dict)
    starts: Mapping[str, State] = field(default_factory=dict)

    @property
    def acting(self) -> tuple[Remark, ...]:
        """Those of `ignored` that can do work: a simulation by deltac's solvers is without them."""
        return tuple(remark for remark in self.ignored if "channel '" in remark.consequence)

    def summary(self) -> str:
        """All remarks, one a line, under their three headings."""
        lines = [f"Imported from {self.source}"]
        for heading, remarks in (
            ("read", self.read),
            ("ignored", self.ignored),
            ("assumed", self.assumed),
        ):
            lines.append(f"{heading}:" + ("" if remarks else " nothing"))
            lines.extend(f"  {remark}" for remark in remarks)
        return "\n".join(lines)

    def sections(self) -> Iterator[str]:
        """The same in short, a paragraph each: the first remarks of each kind."""
        counts = f"{len(self.read)} elements read, {len(self.ignored)} left to the log"
        yield f"Model: {self.source}, {counts}, {len(self.assumed)} assumed."
        for heading, remarks in (("Left to the log", self.ignored), ("Assumed", self.assumed)):
            shown = "; ".join(f"{r.element} ({r.what})" for r in remarks[:SHOWN])
            if remarks:
                yield f"{heading}: {shown}{'; …' if len(remarks) > SHOWN else ''}."


@dataclass
class Findings:
    """What an import comes upon, as reading goes on: force elements, and the entries of its report."""

    forces: list[Element] = field(default_factory=list)
    read: list[Remark] = field(default_factory=list)
    ignored: list[Remark] = field(default_factory=list)
    assumed: list[Remark] = field(default_factory=list)
    equalities: list[Constraint] = field(default_factory=list)

    def note(self, element: str, what: str) -> None:
        """Something is read."""
        self.read.append(Remark(element, what))

    def assume(self, element: str, what: str, consequence: str = "") -> None:
        """Something is taken for granted."""
        self.assumed.append(Remark(element, what, consequence))

    def leave_to_log(
        self,
        element: str,
        what: str,
        channel: str,
        limits: tuple[float, float] | None = None,
        alias: str = "",
    ) -> None:
        """A force has no counterpart here: as `Remark.logged`."""
        self.ignored.append(Remark.logged(element, what, channel, limits, alias))

    def report(
        self,
        source: str,
        *,
        starts: Mapping[str, State],
        strengths: Mapping[str, tuple[float, ...]] | None = None,
        servo_damping: Mapping[str, float] | None = None,
    ) -> ImportReport:
        """The report of a source, when all is read."""
        return ImportReport(
            source,
            tuple(self.read),
            tuple(self.ignored),
            tuple(self.assumed),
            tuple(self.equalities),
            strengths or {},
            servo_damping or {},
            starts,
        )
