"""`classify`: what kind of system a model is, and what its theory says of it before anything is simulated."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deltac.analysis.evaluate import evaluate
from deltac.arrays import ASSEMBLED, SAME, Array, max_norm
from deltac.calls.arguments import checked
from deltac.diagnosis.residuals.states import TRIAL_STATES, random_states
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.equations_of_motion import (
    EquationsOfMotion,
    equations_of_motion,
    evaluate_at,
    matrices,
)
from deltac.dynamics.independence import independence, row_names
from deltac.dynamics.momentum import momentum_balances
from deltac.dynamics.terms import Reactions, driving_forces, terms
from deltac.dynamics.testing_functions import TESTING_FUNCTIONS, applicable
from deltac.errors import InputError
from deltac.mechanism.state import State
from deltac.models import ModelLike, StateLike, load_model
from deltac.results import Report, Section, Table, number
from deltac.simulation.constraints.assembly import assemble

EXAMINED = 150
"""Free speeds up to which constants of the motion and energies are sought: the mass matrix in symbols grows
with their square, and takes 20 s of processor time for a chain of 200 hinges."""


@dataclass(frozen=True)
class DescribedJoint:
    """A joint of the tree: its kind, from which body to which, and whether it is prescribed."""

    name: str
    kind: str
    parent: str
    child: str
    prescribed: bool


@dataclass(frozen=True, eq=False, repr=False)
class Classification(Report, also=("kind",)):
    """The class of a mechanism, in the terms of analytical dynamics.

    Attributes:
        mechanism: its name.
        bodies: their names.
        joints: each with its kind and bodies.
        freedom: degrees of freedom, the number of independent speeds.
        scleronomic: constraints and prescribed joints admit the same configurations at all times; else
            rheonomic. An integrable motion constraint counts as the configuration constraint that it is.
        catastatic: velocities may all be zero, v_t = 0; else acatastatic.
        moving: names of the prescribed joints and the constraints that make v_t ≠ 0: f_t ≠ 0 or b ≠ 0.
        holonomic: every motion constraint can be integrated to one of configuration, or there is none.
        motion_constraints: names of the constraints on velocities that are not integrable.
        integrable: names of the velocity constraints that can be integrated to configuration constraints.
        redundant: the rows that follow from others, in words; "" if there are none.
        testing_functions: those that apply.
        coincide: groups of them with the same power and, up to a constant, the same energy.
        constant: what stays constant in every exact motion: "energy" K + V, "Jacobi integral" K2 − K0 + V,
            and momenta by name.
        nonpotential: channels whose forces have no potential.
        events: names of impacts, stops and other events, at which constants of the motion may jump.
        energies: K and V at the state (J).
        unexamined: why `constant` and `energies` are empty although the model may have both; else "".
    """

    mechanism: str
    bodies: tuple[str, ...]
    joints: tuple[DescribedJoint, ...]
    freedom: int
    scleronomic: bool
    catastatic: bool
    moving: tuple[str, ...]
    holonomic: bool
    motion_constraints: tuple[str, ...]
    integrable: tuple[str, ...]
    redundant: str
    testing_functions: tuple[str, ...]
    coincide: tuple[tuple[str, ...], ...]
    constant: tuple[str, ...]
    nonpotential: tuple[str, ...]
    events: tuple[str, ...]
    energies: dict[str, float]
    unexamined: str = ""

    @property
    def kind(self) -> str:
        """In the usual words, as "holonomic, rheonomic" or "nonholonomic, scleronomic, catastatic".

        A holonomic system is rheonomic if and only if it is acatastatic, so the one word is enough.
        """
        words = ["holonomic" if self.holonomic else "nonholonomic"]
        words.append("scleronomic" if self.scleronomic else "rheonomic")
        if not self.holonomic:
            words.append("catastatic" if self.catastatic else "acatastatic")
        return ", ".join(words)

    def summary(self) -> str:
        """The class in one line."""
        bodies = f"{len(self.bodies)} bodies" if len(self.bodies) != 1 else "1 body"
        freedom = f"{self.freedom} degree{'s' if self.freedom != 1 else ''} of freedom"
        return f"{self.mechanism}: {bodies}, {freedom}; {self.kind}"

    def sections(self) -> Iterator[Section]:
        """What it is made of, what kind it is, what stays constant."""
        yield self.summary()
        rows = tuple(
            (j.name, f"{j.kind}, prescribed" if j.prescribed else j.kind, j.parent, j.child)
            for j in self.joints
        )
        yield Table(("joint", "kind", "from", "to"), rows)
        if self.motion_constraints:
            yield f"not integrable: {', '.join(self.motion_constraints)}"
        if self.integrable:
            yield f"integrable, though written on velocities: {', '.join(self.integrable)}"
        if self.moving:
            yield f"acatastatic, v_t ≠ 0: {', '.join(self.moving)}"
        if self.redundant:
            yield f"redundant rows: {self.redundant}"
        yield f"testing functions: {', '.join(self.testing_functions)}"
        for group in self.coincide:
            yield f"the same function here: {', '.join(group)}"
        if self.unexamined:
            yield self.unexamined
        else:
            none = "neither energy nor a momentum of a ground joint"
            yield f"constant: {', '.join(self.constant) or none}"
        if self.nonpotential:
            yield f"forces without a potential: {', '.join(self.nonpotential)}"
        if self.events:
            yield f"constant only between events: {', '.join(self.events)}"
        if self.energies:
            energies = ", ".join(f"{n} = {number(x, 'J', 6)}" for n, x in self.energies.items())
            yield f"at the state: {energies}"


@checked
def classify(model: ModelLike, state: StateLike = None) -> Classification:
    """Classify a mechanism, and find redundant constraints and constants of the motion.

    Constants of the motion, integrable constraints and moving ones are found from the equations at random
    admissible states, so that the class does not depend on how a constraint is written: a motion constraint
    u = f(t) and the configuration constraint that is its integral are both rheonomic. A quantity that is
    constant in some motions only is not listed, such as an angular momentum that is zero at the start. Nor
    is the energy if a force has no potential, even where that force does no work.

    Args:
        model: a Mechanism, a Problem, a problem's name, a model file or ``file.py:callable``.
        state: where constraints are counted and energies are evaluated; by default the model's own start,
            else all coordinates and speeds zero, assembled.

    Raises:
        InputError: there is no such model, or its constraints cannot be met.
    """
    loaded = load_model(model)
    mechanism = loaded.mechanism
    motion = equations_of_motion(mechanism)
    if state is None and not loaded.starts:
        state = assemble(mechanism, mechanism.state()).state
    else:
        state = loaded.start(state)
    free, rows = mechanism.free, motion.rows
    ranks = independence(motion, state.t, state.q[free.q])
    large = len(free.u) > EXAMINED
    t, q, u = _of(motion, state) if large else _states(motion, state)
    driven, moving_rows = _moving(motion, t, q)
    acatastatic = bool(driven or moving_rows)
    velocity = {k for k in range(len(rows)) if not rows.holonomic[k]}
    integrable = _integrable(motion, velocity, t, q)
    nonholonomic = _names(rows, velocity - integrable)
    functions = applicable(constrained=bool(len(rows)) and ranks.generic > 0)
    nonpotential = tuple(
        part.name
        for part in motion.channels
        if part.logged or (part.potential is None and _depends(part.force))
    )
    constant: tuple[str, ...] = ()
    energies: dict[str, float] = {}
    if not large:
        constant = _constant(motion, t, q, u, bool(nonpotential), acatastatic)
        at = evaluate(mechanism, state)
        energies = {"K": float(at.kinetic), "V": float(sum(at.potential.values()))}
    with_potential = [n for n in functions if n != "liu-huston"]
    return Classification(
        mechanism=mechanism.name,
        bodies=tuple(body.name for body in mechanism.bodies),
        joints=tuple(
            DescribedJoint(j.name, j.kind, j.parent, j.child, j.prescribed)
            for j in mechanism.joints
        ),
        freedom=ranks.generic,
        scleronomic=not driven and moving_rows <= velocity - integrable,
        catastatic=not acatastatic,
        moving=driven + _names(rows, moving_rows),
        holonomic=not nonholonomic,
        motion_constraints=nonholonomic,
        integrable=tuple(n for n in _names(rows, velocity) if n not in nonholonomic),
        redundant=row_names(rows, ranks.redundant),
        testing_functions=functions,
        coincide=() if acatastatic or len(with_potential) < 2 else (tuple(with_potential),),
        constant=constant,
        nonpotential=nonpotential,
        events=tuple(event.name for event in mechanism.events),
        energies=energies,
        unexamined=f"constants of the motion and energies: not sought above {EXAMINED} free speeds"
        if large
        else "",
    )


def _depends(expression: Any) -> bool:
    """Whether an expression is anything but zero."""
    return bool(ca.sparsify(ca.simplify(ca.densify(expression))).nnz())


def _names(rows: ConstraintRows, places: Collection[int]) -> tuple[str, ...]:
    """The constraints of some rows, each once."""
    return tuple(dict.fromkeys(rows.names[k] for k in sorted(places)))


def _moving(motion: EquationsOfMotion, t: Array, q: Array) -> tuple[tuple[str, ...], set[int]]:
    """Prescribed joints that move, and rows with f_t ≠ 0 or b ≠ 0 on the configurations that they admit.

    Time may appear in a row that does not move: e^t (q1 − q2) = 0 has f_t = e^t (q1 − q2), zero wherever the
    row holds. So f_t and b count as zero where they are no larger than their change within the accuracy of
    the configurations.
    """
    s, rows = motion.system, motion.rows
    joints = [s.mechanism.speeds[place].joint for place in s.driven_u]
    rates = ca.vertcat(rows.b, *(s.u_all[place] for place in s.driven_u))
    if not _depends(rates):
        return (), set()
    slope = ca.jacobian(rates, ca.vertcat(s.t, s.q))
    columns = [ca.densify(rates), ca.densify(ca.vec(slope))]
    f = ca.Function("rates", [s.t, s.q], columns, {"cse": True})
    values, slopes = evaluate_at(f, t[None, :], q)
    accuracy = ASSEMBLED * np.maximum(
        np.vstack([0.0 * t, np.ones_like(q)]), np.abs(np.vstack([t, q]))
    )
    change = np.einsum("bri,ib->rb", np.abs(matrices(slopes, *slope.shape)), accuracy)
    moves = (np.abs(values) > change).any(axis=1)
    driven = tuple(dict.fromkeys(n for n, m in zip(joints, moves[len(rows) :]) if m))
    return driven, set(np.flatnonzero(moves[: len(rows)]).tolist())


def _states(motion: EquationsOfMotion, state: State) -> tuple[Array, Array, Array]:
    """Admissible states t (B,), q (nq, B), u (p, B): random ones, or the state itself where none is found."""
    mechanism = motion.system.mechanism
    try:
        states = random_states(mechanism, count=TRIAL_STATES)
    except InputError:
        return _of(motion, state)
    return states.t, states.q, states.u


def _of(motion: EquationsOfMotion, state: State) -> tuple[Array, Array, Array]:
    """A state as the only one of a batch."""
    free = motion.system.mechanism.free
    return np.array([state.t]), state.q[free.q][:, None], state.u[free.u][:, None]


def _integrable(motion: EquationsOfMotion, velocity: set[int], t: Array, q: Array) -> set[int]:
    """The rows among `velocity` that follow from configuration constraints (Frobenius).

    The forms are ω = G W⁺ dq + b dt on the space of (q, t); an allowed motion is (W k, τ) with G k + b τ = 0.
    A set of rows is integrable if the dω of each vanishes on all pairs of motions that the set allows,
    together with the configuration constraints. Rows that fail are taken out until none does.
    """
    s, rows = motion.system, motion.rows
    if not velocity:
        return set()
    order = sorted(velocity)
    W = motion.W
    plus = ca.solve(ca.mtimes(W.T, W), W.T)
    rate_at_rest = rows.at_rest(s.u)
    forms = ca.horzcat(ca.mtimes(rows.G[order, :], plus), rate_at_rest[order])
    at = ca.vertcat(s.q, s.t)
    jacobians = [ca.jacobian(forms[k, :].T, at) for k in range(len(order))]
    curls = [slope - slope.T for slope in jacobians]
    dense = [ca.densify(ca.vec(x)) for x in (rows.G, rate_at_rest, W, *curls)]
    f = ca.Function("curls", [s.t, s.q], dense, {"cse": True})
    G, b, W_, *curl = evaluate_at(f, t[None, :], q)
    p, n, nc = s.u.shape[0], q.shape[0], len(rows)
    extended = np.concatenate([matrices(G, nc, p), b.T[:, :, None]], axis=2)
    velocities = matrices(W_, n, p)
    curl_of = {k: matrices(values, n + 1, n + 1) for k, values in zip(order, curl)}
    configuration = set(range(nc)) - velocity
    integrable = set(velocity)
    while True:
        closed = set(integrable)
        for i in range(q.shape[1]):
            moves = _allowed(extended[i, sorted(configuration | integrable)], velocities[i])
            for k in integrable:
                size = np.abs(moves).T @ np.abs(curl_of[k][i]) @ np.abs(moves)
                rounding = 1e-8 * max(1.0, size.max(initial=0.0))
                if max_norm(moves.T @ curl_of[k][i] @ moves) > rounding:
                    closed.discard(k)
        if closed == integrable:
            return integrable
        integrable = closed


def _allowed(extended: Array, W: Array) -> Array:
    """The motions (q̇, ṫ), n+1 by k, that rows (G b) allow at a configuration, q̇ = W u."""
    _, sizes, V = np.linalg.svd(extended)
    kernel = V[int((sizes > 1e-9 * max(1.0, sizes.max(initial=0.0))).sum()) :].T
    moves: Array = np.vstack([W @ kernel[:-1], kernel[-1:]])
    return moves


def _constant(
    motion: EquationsOfMotion, t: Array, q: Array, u: Array, lossy: bool, acatastatic: bool
) -> tuple[str, ...]:
    """Energy, Jacobi's integral and momenta that no force and no constraint changes, at the states."""
    s, rows = motion.system, motion.rows
    udot, lam_values = motion.solved(motion.terms(t, q, u))
    lam = ca.SX.sym("lambda", len(rows))
    places = independence(motion, float(t[0]), q[:, 0]).independent
    constrained = motion.constrained(places)
    # Rounding is measured by the sum of the magnitudes, whether or not the terms cancel.
    pulls = [part.force for part in motion.channels]
    pulls += [rows.G_all[k, :].T * lam[k] for k in range(len(rows))]
    total = sum((ca.norm_2(ca.densify(pull)) for pull in pulls), start=ca.SX(1e-12))
    powers: dict[str, Any] = {}
    sizes: dict[str, Any] = {}
    for balance in momentum_balances(s):
        powers[balance.name] = sum((ca.dot(balance.alpha, x) for x in pulls), start=ca.SX(0))
        sizes[balance.name] = ca.norm_2(ca.densify(balance.alpha)) * total
    if not lossy:
        multipliers = lam[list(places)]
        driving = driving_forces(s, s.udot_all, motion.channels, constrained, multipliers)
        reactions = Reactions(driving, multipliers)
        parts = terms(s, s.udot_all, motion.channels, None, constrained, reactions)
        flow = total * ca.norm_2(ca.densify(s.u_all)) + ca.fabs(parts.inertia_transport)
        powers["energy"], sizes["energy"] = TESTING_FUNCTIONS["wang"].P(parts), flow
        if acatastatic:
            powers["Jacobi integral"] = TESTING_FUNCTIONS["kane-levinson-1990"].P(parts)
            sizes["Jacobi integral"] = flow + ca.fabs(parts.rate_1990)
    names = list(powers)
    columns: Any = [ca.vertcat(*(by_name[n] for n in names)) for by_name in (powers, sizes)]
    no_inputs = ca.SX.zeros(s.inputs.shape[0])
    columns = ca.substitute(
        [ca.densify(ca.vertcat(ca.SX(0, 1), x)) for x in columns], [s.inputs], [no_inputs]
    )
    f = ca.Function("powers", [s.t, s.q, s.u, s.udot, lam], columns, {"cse": True})
    power, size = evaluate_at(f, t[None, :], q, u, udot.T, lam_values.T)
    vanishing = np.asarray((np.abs(power) <= SAME * size).all(axis=1)).tolist()
    order = {"energy": 0, "Jacobi integral": 1}
    constants = [name for name, zero in zip(names, vanishing) if zero]
    return tuple(sorted(constants, key=lambda name: order.get(name, 2)))
