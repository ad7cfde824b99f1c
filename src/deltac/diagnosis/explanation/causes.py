"""All causes that a mechanism may have: gravity, bodies, joints, channels, constant forces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from deltac.diagnosis.equations import Evaluator
from deltac.diagnosis.explanation.bodies import of_bodies
from deltac.diagnosis.explanation.candidates import Candidate, Places, one
from deltac.diagnosis.explanation.columns import Column, What
from deltac.mechanism.forces import JointDamper, JointSpring

PUSHES: tuple[tuple[What, str, str], ...] = (
    ("force", "applied-force", "N"),
    ("moment", "applied-moment", "N·m"),
    ("body-force", "thrust", "N"),
    ("body-moment", "body-torque", "N·m"),
)
"""Forces and moments on a body that a model may lack: in world components, and turning with the body."""


def candidates(evaluator: Evaluator, columns: Sequence[Column]) -> tuple[Candidate, ...]:
    """All causes of a mechanism whose columns there are."""
    places = Places({column: k for k, column in enumerate(columns)})
    found: list[Candidate] = []
    for part in (_gravity, of_bodies, _speeds, _channels, _wrenches):
        found.extend(part(evaluator, places))
    # Where columns are missing, since they are zero, several numbers may mean the same as one.
    return tuple(c for c in found if c.size == 1 or np.linalg.matrix_rank(c.linear) == c.size)


def _gravity(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    g = np.array([evaluator.mechanism.number(x) for x in evaluator.mechanism.gravity])
    axes = [places(Column("gravity", "", k)) for k in range(3)]
    columns = tuple(p[0] for p in axes if p is not None)
    active = [k for k, p in enumerate(axes) if p is not None]
    if not active:
        return
    if g[active].any():
        yield from one("gravity", "gravity", columns, list(g[active]), "factor", 1.0, "1")
    yield Candidate(
        "gravity-vector", "gravity", columns, np.eye(len(active)), tuple("xyz"[k] for k in active),
        g[active], ("m/s²",) * len(active),
    )  # fmt: skip


# --- joints, channels, forces -----------------------------------------------------------------------


def _speeds(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    """What may act on a joint: damper, dry friction, rotor inertia, spring, constant force."""
    mechanism = evaluator.mechanism
    number = mechanism.number
    for place in evaluator.symbols.system.free_u:
        entry = mechanism.speeds[place]
        joint = mechanism.joint(entry.joint)
        row = place - mechanism.speeds.of(joint.name).start
        single = len(joint.speeds) == 1
        turning = entry.unit == "rad/s"
        force, per = ("N·m", "rad") if turning else ("N", "m")
        own = {
            type(e): (e, f"{kind} {e.name}")
            for e in mechanism.elements
            for kind, cls in (("damper", JointDamper), ("spring", JointSpring))
            if isinstance(e, cls)
            and e.joint == joint.name
            and places(Column("channel", f"{kind} {e.name}")) is not None  # which is not zero
        }
        damper, spring = own.get(JointDamper), own.get(JointSpring)
        acting = {c.element for c in places.of if c.what == "channel"}

        def at(what: What, name: str = entry.name) -> tuple[int, ...] | None:
            return places(Column(what, name))

        has_damper = single and (damper is not None or f"damper {joint.name}" in acting)
        if not has_damper:
            yield from one(
                "missing-damper", entry.name, at("damper"), [1.0], "damping", 0.0,
                f"{force}·s/{per}", "positive",
            )  # fmt: skip
        elif damper is not None and damper[1] not in evaluator.log.places:
            law = getattr(damper[0], "damping", (None,))[0]
            if isinstance(law, float):
                yield from one(
                    "damping", entry.name, at("damper"), [1.0], "damping", law, f"{force}·s/{per}"
                )
        if f"friction {joint.name}" not in acting:
            yield from one(
                "missing-friction", entry.name, at("friction"), [1.0], "friction", 0.0, force,
                "positive",
            )  # fmt: skip
        have = number(joint.armature[row]) if joint.armature else 0.0
        yield from one(
            "armature" if have else "missing-rotor-inertia", entry.name, at("armature"), [1.0],
            "rotor inertia", have, "kg·m²" if turning else "kg", "positive",
        )  # fmt: skip
        stiffness = getattr(spring[0], "stiffness", ()) if spring else ()
        if spring is None and f"spring {joint.name}" not in acting:
            yield from one(
                "missing-spring", entry.name, at("spring"), [1.0], "stiffness", 0.0,
                f"{force}/{per}", "positive",
            )  # fmt: skip
            both = (*(at("spring") or ()), *(at("constant") or ()))
            if len(both) == 2:
                yield Candidate(
                    "missing-spring", entry.name, both, np.eye(2), ("stiffness", "force at zero"),
                    np.zeros(2), (f"{force}/{per}", force),
                )  # fmt: skip
        elif row < len(stiffness) and isinstance(stiffness[row], float) and spring is not None:
            rest = spring[0].rest[row] if isinstance(spring[0], JointSpring) else None
            if isinstance(rest, float) and stiffness[row]:
                yield from one(
                    "rest-angle", entry.name, at("constant"), [stiffness[row]], "rest", rest, per
                )
                continue  # a constant force would be the same
        yield from one("constant-force", entry.name, at("constant"), [1.0], "force", 0.0, force)


def _channels(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    mechanism = evaluator.mechanism
    constant = {
        f"damper {e.name}"
        for e in mechanism.elements
        if isinstance(e, JointDamper)
        and len(mechanism.joint(e.joint).speeds) == 1
        and isinstance(e.damping[0], float)
    }
    linear = {
        f"spring {e.name}": e
        for e in mechanism.elements
        if isinstance(e, JointSpring) and len(e.stiffness) == 1
    }
    for part in evaluator.symbols.parts:
        name = part.name
        at = places(Column("channel", name))
        logged = name in evaluator.log.places
        if at is None or (name in constant and not logged):
            continue
        origin = "logged" if logged else "computed"
        spring = linear.get(name)
        if spring is not None and not logged and isinstance(spring.stiffness[0], float):
            k = spring.stiffness[0]
            turning = mechanism.speeds[mechanism.speeds.of(spring.joint)][0].unit == "rad/s"
            unit = "N·m/rad" if turning else "N/m"
            yield from one("stiffness", spring.joint, at, [1.0 / k], "stiffness", k, unit)
            continue
        kind = "actuator-gear" if name.startswith("actuator ") else "channel-factor"
        yield from one(kind, name, at, [1.0], "factor", 1.0, "1", origin=origin)
        first, second = (places(Column("delay", name, k)) for k in range(2))
        if first is not None and second is not None:
            Q = np.zeros((2, 1, 1))
            Q[1] = 1.0
            yield Candidate(
                "actuator-delay", name, (*first, *second), np.array([[1.0], [0.0]]), ("delay",),
                np.zeros(1), ("s",), "any", Q, origin,
            )  # fmt: skip


def _wrenches(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    for link in evaluator.symbols.system.links:
        body = link.joint.child
        for what, kind, unit in PUSHES:
            found = [
                (k, p[0]) for k in range(3) if (p := places(Column(what, body, k))) is not None
            ]
            groups = [[f] for f in found] + ([found] if len(found) > 1 else [])
            for group in groups:
                yield Candidate(
                    kind, body, tuple(p for _, p in group), np.eye(len(group)),
                    tuple("xyz"[k] for k, _ in group), np.zeros(len(group)), (unit,) * len(group),
                )  # fmt: skip
