"""How fast friction and contact act, and what that asks of a step; overlaps at the start of a run.

Contact and regularised friction are stiff: an explicit step must follow the oscillation of a mass on its
contact, √(m_eff/k), and the decay of slip within the friction's width, m_eff w/(μ N). Both are estimated
at the start of a run, from the effective mass 1/(J M⁻¹ Jᵀ) of each contact point.
A touch to come must be resolved by implicit steps too. What a step may be is told by `stiffness`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.calls.caching import LRUCache
from deltac.dynamics.gaps import Gap, gaps, sliding_point
from deltac.dynamics.points import PlacedPoint
from deltac.dynamics.recursions import crba
from deltac.dynamics.system import System, trace
from deltac.errors import StateError, warn_user
from deltac.mechanism.contact import Contact
from deltac.mechanism.friction import FrictionLaw, JointFriction, PointFriction
from deltac.mechanism.laws import evaluate
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.solvers import Solver
from deltac.simulation.step_size.stiffness import StiffStepWarning, longest_step, remedy


@dataclass(frozen=True)
class TimeScale:
    """A time (s) within which a force element acts, estimated at a state.

    `element` has the name ("contact floor"), `kind` is "oscillation" (τ = √(m_eff/k), the period is 2πτ)
    or "decay" (dissipation or friction reduces a speed to 1/e within τ); `why` explains it.
    `touch` says that an impact is ahead, which lasts about πτ.
    """

    element: str
    kind: str
    value: float
    why: str
    touch: bool = False

    @property
    def rate(self) -> complex:
        """λ (1/s) of the motion exp(λ t): i/τ of an oscillation, −1/τ of a decay."""
        return (1j if self.kind == "oscillation" else -1.0) / self.value


def time_scales(mechanism: Mechanism, state: State) -> tuple[TimeScale, ...]:
    """Time scales of friction and contacts, the shortest first: the core of `deltac.time_scales`."""
    return tuple(sorted(_found(mechanism, state), key=lambda scale: scale.value))


def check_start(mechanism: Mechanism, state: State, solver: Solver, step: float | None) -> None:
    """InputError for shapes that overlap too deeply; warns `StiffStepWarning` of a step too large."""
    if not any(isinstance(e, Contact | JointFriction | PointFriction) for e in mechanism.elements):
        return
    _check_overlaps(mechanism, state)
    if not solver.takes_steps or step is None:
        return
    limits = [
        (longest_step(solver, scale.rate, touch=scale.touch), scale)
        for scale in time_scales(mechanism, state)
    ]
    longest, worst = min(limits, key=lambda limit: limit[0], default=(math.inf, None))
    if worst is not None and step > longest:
        warn_user(
            f"step {step:g} s is too large for {worst.element}: {worst.why} has the time scale "
            f"{worst.value:.3g} s. {remedy(longest)}. A softer contact, or friction of larger width, "
            f"allows longer steps",
            StiffStepWarning,
        )


# --- at a state --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Touch:
    """A contact point at a state: gap, normal, relative velocity, W = J M⁻¹ Jᵀ (3, 3; 1/kg)."""

    label: str
    gap: float
    n: Array
    velocity: Array
    W: Array

    @property
    def mass(self) -> float:
        """Effective mass along the normal (kg); without bound if nothing moves there."""
        return _inverse(float(self.n @ self.W @ self.n))

    @property
    def sliding_mass(self) -> float:
        """The least effective mass across the normal (kg)."""
        across = np.eye(3) - np.outer(self.n, self.n)
        return _inverse(float(np.linalg.eigvalsh(across @ self.W @ across)[-1]))


_MODES: LRUCache[tuple[dict[str, tuple[str, ...]], Any]] = LRUCache(16)


def _touches(mechanism: Mechanism, state: State) -> tuple[dict[str, list[_Touch]], Array]:
    """The contact points of every element that has some, and M⁻¹ of the free speeds."""

    def make() -> tuple[dict[str, tuple[str, ...]], Any]:
        system = trace(mechanism)
        free = system.free_u
        labels: dict[str, tuple[str, ...]] = {}
        columns = []
        for element in mechanism.elements:
            points = _points(system, element)
            if points:
                labels[element.name] = tuple(p.label for p in points)
            for point in points:
                # Apart, each surface point is taken where it is: it is there that they would touch.
                one, other = (
                    PlacedPoint.at(system, k, place).velocity
                    for k, place in zip(point.links, (point.on_first, point.on_second))
                )
                v = one - other
                J = ca.jacobian(v, system.u)
                columns.append(ca.vertcat(point.gap, point.n, v, ca.vec(J)))
        height = 7 + 3 * len(free)
        table = ca.densify(ca.horzcat(*columns)) if columns else ca.SX(height, 0)
        M = ca.densify(crba(system)[free, free])
        return labels, ca.Function("touches", [system.t, system.q, system.u], [table, M])

    labels, f = _MODES.get(mechanism.digest(), make)
    free = mechanism.free
    table, M = (np.array(x) for x in f(state.t, state.q[free.q], state.u[free.u]))
    inverse = np.linalg.pinv(M)
    touches: dict[str, list[_Touch]] = {}
    rows = iter(table.T)
    for name, some in labels.items():
        touches[name] = []
        for label in some:
            row = next(rows)
            J = row[7:].reshape(3, -1, order="F")
            touches[name].append(
                _Touch(label, float(row[0]), row[1:4], row[4:7], J @ inverse @ J.T)
            )
    return touches, inverse


def _points(system: System, element: object) -> tuple[Gap, ...]:
    match element:
        case Contact():
            return gaps(system, element.first, element.second)
        case PointFriction():
            return (sliding_point(system, element.body, element.point, element.on, element.normal),)
    return ()


def _found(mechanism: Mechanism, state: State) -> Iterator[TimeScale]:
    touches, inverse = _touches(mechanism, state)
    values = {**mechanism.parameters, "t": state.t}
    values |= {f"q.{e.name}": float(state.q[e.index]) for e in mechanism.coordinates}
    values |= {f"u.{e.name}": float(state.u[e.index]) for e in mechanism.speeds}
    place = {int(i): k for k, i in enumerate(mechanism.free.u)}
    for element in mechanism.elements:
        match element:
            case Contact():
                lies = any(touch.gap <= 0.0 for touch in touches[element.name])
                for touch in touches[element.name]:
                    yield from _of_contact(mechanism, element, touch, lies=lies)
            case PointFriction():
                (touch,) = touches[element.name]
                slope = max(evaluate(element.normal_force, values), 0.0) * _slope(
                    element.friction, values
                )
                name = f"point friction {element.name!r}"
                yield from _decay(
                    name, touch.sliding_mass, slope, "slip within the friction's width"
                )
            case JointFriction():
                where = mechanism.speeds.of(element.joint)
                for i, law in zip(range(where.start, where.stop), element.laws):
                    mass = _inverse(inverse[place[i], place[i]]) if i in place else math.inf
                    name = f"joint friction {element.name!r}"
                    yield from _decay(name, mass, _slope(law, values), "slip within its width")


def _of_contact(
    mechanism: Mechanism, element: Contact, touch: _Touch, *, lies: bool
) -> Iterator[TimeScale]:
    """Of one point; where a shape `lies` on the other already, a gap elsewhere is no blow to come."""
    m = touch.mass
    if not math.isfinite(m):
        return
    name = f"contact {element.name!r}"
    k, n, d = (
        mechanism.number(x) for x in (element.stiffness, element.exponent, element.dissipation)
    )
    g = math.hypot(*(mechanism.number(component) for component in mechanism.gravity))
    approach2 = max(-float(touch.n @ touch.velocity), 0.0) ** 2 + 2 * g * max(touch.gap, 0.0)
    settled = max(-touch.gap, (m * g / k) ** (1 / n))
    blow = ((n + 1) * m * approach2 / (2 * k)) ** (1 / (n + 1))
    x = max(settled, blow)
    hits = blow > settled and not (lies and touch.gap > 0.0)
    if x <= 0.0:
        if n > 1.0:
            return  # nothing presses: the stiffness is zero
        x = 0.0
    stiffness, force = n * k * x ** (n - 1), k * x**n
    why = f"the oscillation √(m_eff/k) of {m:.3g} kg on {stiffness:.3g} N/m"
    yield TimeScale(name, "oscillation", math.sqrt(m / stiffness), why, hits)
    damping = d * force if element.model == "hunt-crossley" else d
    yield from _decay(name, m, damping, "its dissipation")
    if element.friction is not None:
        slope = force * _slope(element.friction, mechanism.parameters)
        why = "slip within the friction's width"
        yield from _decay(name, touch.sliding_mass, slope, why)


def _decay(element: str, mass: float, slope: float, why: str) -> Iterator[TimeScale]:
    """The decay m/c of a speed by a force c v."""
    if slope > 0.0 and math.isfinite(mass):
        yield TimeScale(element, "decay", mass / slope, why)


def _slope(law: FrictionLaw, values: Mapping[str, float]) -> float:
    """The slope of friction at rest: s/w + b."""
    s, w, b = (evaluate(x, values) for x in (law.static, law.width, law.viscous))
    return s / w + b


def _inverse(mobility: float) -> float:
    return 1.0 / mobility if mobility > 0.0 else math.inf


# --- overlaps ----------------------------------------------------------------------------------------


def _check_overlaps(mechanism: Mechanism, state: State) -> None:
    """InputError for a start at which a contact's shapes overlap more than it allows."""
    touches, _ = _touches(mechanism, state)
    for element in (e for e in mechanism.elements if isinstance(e, Contact)):
        worst = min(touches[element.name], key=lambda touch: touch.gap)
        allowed = 0.1 * element.thickness(mechanism.number)
        if element.deepest is not None:
            allowed = mechanism.number(element.deepest)
        if -worst.gap > allowed:
            pair = f"{element.first.body!r} and {element.second.body!r}"
            at = f" ({worst.label})" if worst.label else ""
            raise StateError(
                f"the start: the shapes of {pair} of contact {element.name!r} overlap by "
                f"{-worst.gap:.4g} m{at}, more than {allowed:.4g} m; move them apart, or write "
                f"contact(..., deepest={-worst.gap * 1.01:.2g}) if that is meant"
            )
