"""What was found, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.explain.causes import SLIPPED, Candidate, other_unit
from deltac.diagnosis.explain.regression import Form
from deltac.diagnosis.verdict import Finding
from deltac.mechanism.mechanism import Mechanism
from deltac.results import Report, Section, Table

SHOWN = 12
"""Elements not seen in a log that a report names; `unseen` has all of them."""

SHOWN_EQUALS = 3
"""Causes that a finding names beside its own, where the log does not tell them apart."""

WORTH_SAYING = 1e-7
"""Relative errors below this are not shown: they are the log's rounding."""


def sentence(mechanism: Mechanism, c: Candidate, theta: Array, error: Array) -> str:
    """One cause with its numbers, as what the run has and the model does not."""
    value, shown = c.base + theta, _numbers(c, theta, error)
    several = f"({shown})" if c.size > 1 else shown
    element = f"`{c.element}`"
    factor = float(value[0])
    match c.kind:
        case "gravity":
            g = float(np.linalg.norm([mechanism.number(x) for x in mechanism.gravity]))
            ours, theirs = f"{g:.6g}", f"{g * factor:.6g}{_error(g * factor, g * error[0])}"
            return f"gravity in the run is {theirs} m/s² instead of {ours} m/s²"
        case "gravity-vector":
            ours = _plain(c.base) if c.size == 1 else f"({_plain(c.base)})"
            return f"gravity in the run is {several} m/s², not {ours}"
        case "mass-scale":
            return f"all masses and inertias in the run are {shown} times those of the model{_more(factor)}"
        case "body-inertia":
            return f"mass and inertia of {element} in the run are {shown} times the model's{_more(factor)}"
        case "body-mass":
            return f"the mass of {element} in the run is {shown} times the model's{_more(factor)}"
        case "body-moments":
            return (
                f"the central moments of inertia of {element} in the run are {shown} times the model's"
                + _more(factor)
            )
        case "body-moment":
            return (
                f"the central moment of inertia {c.names[0]} of {element} in the run is {shown}, not "
                f"{c.base[0]:.6g} kg·m²"
            )
        case "body-tensor":
            return f"the central inertia of {element} in the run is ({shown}) kg·m² (xx, yy, zz, xy, xz, yz)"
        case "body-centre":
            axes = ", ".join(c.names)
            where = f"{several} m along {axes} of the body"
            return f"the mass centre of {element} in the run is displaced by {where}"
        case "velocity-terms" | "gyroscopic-terms":
            which = "centrifugal, Coriolis and gyroscopic terms of all bodies"
            if c.kind == "gyroscopic-terms":
                which = f"gyroscopic terms of {element}"
            if abs(factor) < SLIPPED:
                return f"the {which} are missing in the run"
            sign = " (of the other sign)" if factor < 0.0 else ""
            return f"the {which} are {shown} times the model's in the run{sign}"
        case "actuator-gear":
            return f"{element} delivers {shown} of its {c.origin} force (gear, unit or scale of the actuator)"
        case "channel-factor" if abs(factor) < 3.0 * error[0]:
            return f"{element} does not act in the run: {shown} of its {c.origin} force"
        case "channel-factor":
            return f"{element} acts with {shown} of its {c.origin} force"
        case "actuator-delay":
            return f"{element} acts {shown} s later than logged"
        case "late-rows":
            return f"the coordinates are those of {shown} s before the speeds beside them"
        case "zero-offset":
            return (
                f"the zero of joint {element} is off: it is logged {shown} {c.units[0]} too large"
            )
        case "damping" | "stiffness" | "armature":
            noun = {"damping": "the damping of", "stiffness": "the stiffness of"}
            what = noun.get(c.kind, "the rotor inertia of")
            return f"{what} joint {element} in the run is {shown}, not {c.base[0]:.6g} {c.units[0]}"
        case "rest-angle":
            return (
                f"the spring of joint {element} rests at {shown}, not {c.base[0]:.6g} {c.units[0]}"
            )
        case "constant-force":
            return f"a constant force of {shown} {c.units[0]} acts on joint {element}"
        case "missing-spring" if c.size == 2:
            return (
                f"a spring of {_number(theta[0], error[0])} {c.units[0]} that the model does not have acts "
                f"on joint {element}, with {_number(theta[1], error[1])} {c.units[1]} at zero"
            )
        case "missing-stop" if c.touching is not None:
            side = "above" if theta[1] - theta[0] * c.touching[1] < 0.0 else "below"
            return (
                f"joint {element} touches a stop that the model does not have all the time: a stiffness of "
                f"{_number(theta[0], error[0])} {c.units[0]} {side} {theta[1] / theta[0]:.4g}"
            )
        case "missing-stop":
            where = " and ".join(name.removeprefix("stiffness ") for name in c.names)
            return (
                f"joint {element} has a stop that the model does not have: a stiffness of {several} "
                f"{c.units[0]} {where}"
            )
        case "missing-drag" if c.element in {b.name for b in mechanism.bodies}:
            return f"a drag of {shown} {c.units[0]} times the square of its speed acts on {element}"
        case (
            "missing-damper" | "missing-friction" | "missing-drag" | "missing-rotor-inertia"
            | "missing-spring"
        ):  # fmt: skip
            noun = {
                "missing-damper": "viscous damping",
                "missing-friction": "dry friction",
                "missing-drag": "drag by the square of the speed",
                "missing-rotor-inertia": "rotor inertia",
            }
            return (
                f"a {noun.get(c.kind, 'spring stiffness')} of {shown} {c.units[0]} at joint {element} that "
                "the model does not have"
            )
    along = ", ".join(c.names)
    frame = "the body" if c.kind in ("thrust", "body-torque") else "the world"
    noun_of = "moment" if c.kind in ("applied-moment", "body-torque") else "force"
    return (
        f"a constant {noun_of} of {several} {c.units[0]} along {along} of {frame} acts on {element}"
    )


def remedy(kind: str) -> str:
    """What to do about a cause of a kind."""
    if kind.startswith("gravity"):
        return "Give model and simulator the same gravity"
    if kind == "actuator-gear":
        return "Check the gear ratio and the unit of this actuator's logged force"
    if kind == "actuator-delay":
        return "Log the force that acted, not the one that was commanded"
    if kind == "late-rows":
        return "Write coordinates and speeds of the same instant into one row"
    if kind == "zero-offset":
        return "Calibrate the zero of this coordinate, or subtract the offset"
    if kind in ("velocity-terms", "gyroscopic-terms"):
        return "Check the terms in products of speeds in the equations of the run, or its frames"
    if kind == "channel-factor":
        return "Check this element's parameters in the model, or the unit of its logged force"
    if kind == "mass-scale" or kind.startswith("body-"):
        return "Check masses and inertias of the model against those that the simulator used"
    if kind in ("damping", "stiffness", "armature", "rest-angle"):
        return "Give the model the value that the simulator used"
    return "Add it to the model, or log its force"


def _more(factor: float) -> str:
    if other_unit(np.array(factor)):
        return ", the factor between two units"
    percent = 100.0 * abs(factor - 1.0)
    if percent < 1e-4 or factor <= 0.0:
        return ""
    return f": {percent:.3g} % {'larger' if factor > 1.0 else 'smaller'}"


def _numbers(c: Candidate, theta: Array, error: Array) -> str:
    """Values with errors; a mass that moved and a missing force are told by θ, which is their value."""
    return ", ".join(_number(float(v), float(e)) for v, e in zip(c.base + theta, error))


def _number(value: float, error: float) -> str:
    if abs(value) < error:
        return f"0{_error(1.0, error)}"
    return f"{value:.{_digits(value, error)}g}{_error(value, error)}"


def _digits(value: float, error: float) -> int:
    if not value or not np.isfinite(error) or error <= 0.0:
        return 6
    return int(np.clip(np.ceil(np.log10(abs(value) / error)) + 1, 2, 7))


def _error(value: float, error: float) -> str:
    return "" if error <= WORTH_SAYING * abs(value) else f" ± {error:.2g}"


def _plain(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{float(v):.6g}" for v in values)


# --- what an explanation holds -------------------------------------------------------------------

Kind = Literal["nothing", "explained", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class Cause:
    """A change of the model that would explain the residual.

    kind, element   what, and of which body, joint or channel; "gravity", "body-mass", "missing-damper", …
    values, errors  its numbers with their standard errors: what the run has
    names, units    of these
    model           what the model has in their place
    share           of the squared residual that this cause alone explains of what the others leave
    sentence        all of it in words
    """

    kind: str
    element: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    model: tuple[float, ...]
    share: float
    sentence: str

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True, repr=False)
class Explanation(Report, also=("sentence",)):
    """What explains the residual F_r + F*_r of a log.

    Attributes:
        kind: "nothing" to explain; "explained"; "ambiguous", where other causes do as well; or
            "unexplained" by the causes that are known.
        causes: the fewest that explain it, largest first.
        explained: share of the squared residual that they explain, what is noise left out.
        alternatives: other sets of causes that the log does not tell from these.
        separating: the motion that would tell them apart, or that none does.
        unseen: elements whose masses, inertias or channels the log hardly shows.
        form: "samples", with measured accelerations; "steps", of each row from the one before.
        residual: largest root mean square of an equation's residual, as a share of its terms.
        noise: what of that the noise of the log accounts for.
        samples: how many were looked at.
        predicted: share of the residual that a part of the log predicts of the rest, by all known terms
            together; 0 where there is nothing.
        effect: root mean square of what the causes make of each equation, as a share of its terms.
        work: energy (J) that they do in the time of the log, without sign.
        notes: what the log's forces hide: channels that the model does not have.
    """

    kind: Kind
    causes: tuple[Cause, ...]
    explained: float
    alternatives: tuple[tuple[Cause, ...], ...]
    separating: str
    unseen: tuple[str, ...]
    form: Form
    residual: float
    noise: float
    samples: int
    predicted: float
    effect: tuple[float, ...] = ()
    work: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The outcome in a sentence or two."""
        return ". Note: ".join((self._outcome, *self.notes))

    @property
    def _outcome(self) -> str:
        if self.kind == "nothing":
            return (
                f"There is nothing to explain: the equations of motion hold to {self.residual:.1g} of their "
                f"terms, and noise accounts for {self.noise:.1g}"
            )
        if self.kind == "unexplained":
            nearest = f"; the closest is {self.causes[0]}" if self.causes else ""
            return (
                f"No small set of known causes explains the residual ({self.residual:.2g} of the terms)"
                f"{nearest}, which explains {percent(self.explained)}"
            )
        told = "; ".join(c.sentence for c in self.causes)
        told = f"{told[:1].upper()}{told[1:]}"
        if not any(c.share for c in self.causes):
            closed = f"the equations hold to {self.residual:.1g} of their terms"
            return f"{told}. With the forces as logged, {closed}"
        that = "Together that" if len(self.causes) > 1 else "That"
        said = f"{told}. {that} explains {percent(self.explained)} of the residual"
        if self.kind == "ambiguous":
            others = "; or ".join(" and ".join(map(str, other)) for other in self.alternatives[:4])
            more = len(self.alternatives) - 4
            said += f". These explain the log equally well: {others}"
            said += f"; or {more} more" if more > 0 else ""
            said += f". {self.separating}" if self.separating else ""
        return said

    @property
    def exit_code(self) -> int:
        """Exit code: 0 nothing to explain, 1 a cause explains the residual, 3 none does, or several do."""
        return {"nothing": 0, "explained": 1}.get(self.kind, 3)

    def summary(self) -> str:
        """The outcome in a sentence or two."""
        return self.sentence

    def sections(self) -> Iterator[Section]:
        """The outcome, notes, what was not seen, and the causes with their numbers."""
        told = "" if self.kind in ("nothing", "unexplained") else f"{self.kind}. "
        yield f"{told}{self._outcome}."
        yield from (f"Note: {note}." for note in self.notes)
        if self.unseen:
            shown = ", ".join(self.unseen[:SHOWN]) + (", …" if len(self.unseen) > SHOWN else "")
            yield f"Not observable in this log: {shown}."
        if self.causes:
            heads = ("cause", "of", "in the run", "±", "in the model", "unit", "explains")
            yield Table(heads, self.rows())

    def rows(self) -> tuple[tuple[str, ...], ...]:
        """Cause, element, value in the run, its error, value in the model, unit, share; as text."""
        return tuple(
            (
                c.kind if k == 0 else "",
                c.element if k == 0 else "",
                f"{name} {c.values[k]:.6g}",
                f"{c.errors[k]:.2g}",
                f"{c.model[k]:.6g}",
                c.units[k],
                percent(c.share) if k == 0 else "",
            )
            for c in self.causes
            for k, name in enumerate(c.names)
        )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The causes as findings of an audit; none where the residual is not explained."""
        if self.kind not in ("explained", "ambiguous"):
            return ()
        explains = f"explains {percent(self.explained)} of the residual of the equations of motion"
        if len(self.causes) > 1:
            explains = (
                f"together these explain {percent(self.explained)} of the residual of the equations"
            )
        if self.alternatives:
            explains += ", and so do the others as far as this log tells"
            explains += f". {self.separating}" if self.separating else ""
        found = []
        for c in self.causes:
            equals = self._in_place_of(c)
            told = "; or ".join(" and ".join(map(str, some)) for some in equals[:SHOWN_EQUALS])
            more = f"; or {len(equals) - SHOWN_EQUALS} more" if len(equals) > SHOWN_EQUALS else ""
            others = tuple(dict.fromkeys((x.kind, x.element) for some in equals for x in some))
            what = f"one of these: {c.sentence}; or {told}{more}" if equals else c.sentence
            found.append(
                Finding(
                    c.kind, what, explains, remedy(c.kind), "cause", c.element, c.values[0], c.errors[0],
                    others,
                )
            )  # fmt: skip
        return tuple(found)

    def _in_place_of(self, cause: Cause) -> list[tuple[Cause, ...]]:
        """What the alternatives have in the place of a cause, of which they have none."""
        ours = {(c.kind, c.element) for c in self.causes}
        found = []
        for other in self.alternatives:
            theirs = {(c.kind, c.element) for c in other}
            if (cause.kind, cause.element) not in theirs:
                found.append(tuple(c for c in other if (c.kind, c.element) not in ours))
            elif theirs == ours and len(self.causes) == 1:
                found.append(other)
        return [some for some in found if some]


def percent(share: float) -> str:
    """A share near one, with as many nines as it has."""
    if share == 1.0:
        return "all but noise and rounding"
    return "all but 1e-6" if share > 1 - 1e-6 else f"{100 * share:.4g} %"
