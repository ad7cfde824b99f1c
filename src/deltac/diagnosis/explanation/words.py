"""What was found, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.explanation.candidates import Candidate
from deltac.mechanism.mechanism import Mechanism

Array: TypeAlias = NDArray[np.float64]

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
            return f"the mass centre of {element} in the run is moved by {several} m along {axes} of the body"
        case "actuator-gear":
            return f"{element} delivers {shown} of its {c.origin} force (gear, unit or scale of the actuator)"
        case "channel-factor" if abs(factor) < 3.0 * error[0]:
            return f"{element} does not act in the run: {shown} of its {c.origin} force"
        case "channel-factor":
            return f"{element} acts with {shown} of its {c.origin} force"
        case "actuator-delay":
            return f"{element} acts {shown} s later than it was logged"
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
        case "missing-damper" | "missing-friction" | "missing-rotor-inertia" | "missing-spring":
            noun = {
                "missing-damper": "viscous damping",
                "missing-friction": "dry friction",
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
    if kind == "channel-factor":
        return "Check this element's parameters in the model, or the unit of its logged force"
    if kind == "mass-scale" or kind.startswith("body-"):
        return "Check masses and inertias of the model against those that the simulator used"
    if kind in ("damping", "stiffness", "armature", "rest-angle"):
        return "Give the model the value that the simulator used"
    return "Add it to the model, or log its force"


def _more(factor: float) -> str:
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
