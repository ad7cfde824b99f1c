"""What an ensemble is made of: members' states, steps, solvers and parameters, checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import EPS, Array
from deltac.dynamics.system import trace
from deltac.errors import NO_NUMBER, InputError, SolverError, StateError, WrongType
from deltac.mechanism.coordinates import Entries
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.arguments import count, whole_steps
from deltac.simulation.solvers import FixedStep, Solver, find_solver

LENGTH_ROUNDING = 4 * EPS
"""A quaternion's length differs from one by so little after a division by it."""

States: TypeAlias = State | Sequence[State] | tuple[ArrayLike, ArrayLike]


def member_count(**sizes: int) -> int:
    """How many members there are, of the sizes of what was given; InputError where they differ."""
    if len(set(sizes.values()) - {1}) > 1:
        counts = ", ".join(f"{name} has {size}" for name, size in sizes.items() if size > 1)
        raise InputError(f"members differ in number: {counts}; expected one number N, or 1")
    return max(sizes.values(), default=1)


def repeated(values: Array, members: int, axis: int) -> Array:
    """What all members share, once for each of them."""
    return values if values.shape[axis] == members else np.repeat(values, members, axis)


def member_steps(step: ArrayLike, duration: float) -> Array:
    """Steps (N,) or (1,), made to divide the duration exactly."""
    h = np.atleast_1d(_numbers(step))
    if h.ndim != 1 or not h.size or not np.isfinite(h).all() or not (h > 0).all():
        raise SolverError(f"step {step!r}: expected a positive number of seconds, or an array (N,)")
    exact = {size: duration / whole_steps(duration, size, 1) for size in set(h.tolist())}
    return np.array([exact[size] for size in h.tolist()])


def member_solvers(solver: str | FixedStep | Sequence[str | FixedStep]) -> list[Solver]:
    """The explicit fixed-step solvers of those names; InputError for any other."""
    names = [solver] if isinstance(solver, str) or not isinstance(solver, Iterable) else [*solver]
    if any(isinstance(name, FixedStep) and name.switches for name in names):
        raise SolverError(
            "ensembles step across switches; leave switches out, or simulate one by one"
        )
    names = [name.name if isinstance(name, FixedStep) else name for name in names]
    if not names:
        raise SolverError(f"solver is {solver!r}; expected a name, or N of them")
    solvers = [find_solver(name) for name in names]
    for one in solvers:
        if one.family != "fixed":
            raise SolverError(
                f"ensembles take explicit fixed steps, {one.name!r} does not; use 'ode5' or 'ode8'"
            )
    return solvers


def record_grid(h: Array, duration: float, every: int | None) -> tuple[float, int]:
    """The time between records and their number, not counting the start."""
    longest = float(h.max())
    steps = round(duration / longest)
    every = steps if every is None else count(every, "record: every")
    if steps % every:
        raise SolverError(f"record: every {every} does not divide the number of steps, {steps}")
    records = steps // every
    interval = duration / records
    for size in set(h.tolist()):
        between = interval / size
        if abs(between - round(between)) > 1e-9 * between:
            raise SolverError(
                f"step {size:g} does not divide the time between records, {interval:g} s; choose "
                "what is recorded so that all steps do"
            )
    return interval, records


def member_parameters(
    mechanism: Mechanism, vary: Mapping[str, ArrayLike], sensitivity: Sequence[str]
) -> tuple[Mechanism, list[str], Array]:
    """Names and values (n, N) of the parameters kept as symbols; those of `sensitivity` come last.

    The mechanism has them as parameters: plain numbers of it may be named, too (`Mechanism.numbers`).
    """
    if not isinstance(vary, Mapping):
        raise InputError(
            f"vary is {vary!r}; expected values (N,) by name, such as {{'m': [1.0, 2.0]}}"
        )
    if isinstance(sensitivity, str) or len(set(sensitivity)) < len(sensitivity):
        raise InputError(f"sensitivity={sensitivity!r}: expected distinct names of parameters")
    names = [name for name in vary if name not in sensitivity] + list(sensitivity)
    mechanism = mechanism.opened(*vary, where="vary: ")
    mechanism = mechanism.opened(*sensitivity, where="sensitivity: ")
    columns = []
    for name in names:
        numbers = vary.get(name, mechanism.parameters[name])
        values = np.atleast_1d(_numbers(numbers))
        if values.ndim != 1 or not values.size or not np.isfinite(values).all():
            raise InputError(
                f"vary: the values of {name!r} are {numbers!r}; expected finite numbers, an array (N,)"
            )
        columns.append(values)
    count = member_count(**{f"parameter {name}": len(c) for name, c in zip(names, columns)})
    table = np.array([np.broadcast_to(c, count) for c in columns]).reshape(len(names), count)
    _check_extremes(mechanism, names, table)
    return mechanism, names, table


def _numbers(numbers: object) -> Array:
    """An array of what was given; an empty one if these are no numbers."""
    try:
        return np.asarray(numbers, dtype=np.float64)
    except NO_NUMBER:
        return np.empty(0)


def _check_extremes(mechanism: Mechanism, names: Sequence[str], table: Array) -> None:
    """InputError if the members with a parameter's least or largest value are no mechanisms."""
    for values in table:
        for k in {int(values.argmin()), int(values.argmax())}:
            member = dict(zip(names, map(float, table[:, k])))
            try:
                mechanism.with_parameters(**member)
            except InputError as error:
                parameters = ", ".join(f"{name} = {value:g}" for name, value in member.items())
                raise InputError(f"vary: member {k} ({parameters}): {error}") from None


def member_states(mechanism: Mechanism, states: States) -> tuple[float, Array, Array]:
    """Start time, Q (N, nq), U (N, nu), of finite values, quaternions of unit length.

    N = 1 for a state that all share.
    """
    several = [states] if isinstance(states, State) else states
    if not isinstance(several, list | tuple) or not several:
        raise StateError(f"states: found {_description(states)}; {_EXPECTED}")
    if any(isinstance(one, State) for one in several):
        t, Q, U = _gathered(mechanism, several)
    elif len(several) == 2:
        t, Q, U = 0.0, *(_array(what, values) for what, values in zip("QU", several))
    else:
        raise StateError(
            f"states: found a {type(several).__name__} of {len(several)} entries; {_EXPECTED}"
        )
    _check_values("Q", Q, mechanism.coordinates)
    _check_values("U", U, mechanism.speeds)
    if len(Q) != len(U):
        raise InputError(f"Q has {len(Q)} members, U has {len(U)}")
    return t, _with_unit_quaternions(mechanism, Q), U


_EXPECTED = "expected a State, a sequence of States, or (Q, U) of shapes (N, nq) and (N, nu)"


def _description(value: object) -> str:
    shape = getattr(value, "shape", None)
    return type(value).__name__ if shape is None else f"one array of shape {shape}"


def _gathered(mechanism: Mechanism, states: Sequence[object]) -> tuple[float, Array, Array]:
    """The common time of states, and their coordinates and speeds by rows."""
    nq, nu = len(mechanism.coordinates), len(mechanism.speeds)
    gathered: list[State] = []
    for k, state in enumerate(states):
        if not isinstance(state, State):
            raise WrongType(
                f"states: member {k} is of type {type(state).__name__}; expected a State, as others"
            )
        if state.q.shape != (nq,) or state.u.shape != (nu,):
            raise StateError(
                f"states: member {k} has {state.q.size} coordinates and {state.u.size} speeds; the "
                f"mechanism {mechanism.name!r} has {nq} and {nu}. Make it by mechanism.state(...)"
            )
        if gathered and state.t != gathered[0].t:
            raise StateError(
                f"states: member {k} starts at t = {state.t:g} s, member 0 at {gathered[0].t:g} s; expected "
                "one time for all"
            )
        gathered.append(state)
    return gathered[0].t, np.array([s.q for s in gathered]), np.array([s.u for s in gathered])


def _array(what: str, values: ArrayLike) -> Array:
    try:
        return np.atleast_2d(np.asarray(values, dtype=np.float64))
    except NO_NUMBER as error:
        raise InputError(
            f"{what}: expected numbers, an array (N, n{what.lower()}); {error}"
        ) from None


def _check_values(what: str, values: Array, entries: Entries) -> None:
    if values.ndim != 2 or not len(values) or values.shape[1] != len(entries):
        raise InputError(
            f"{what} has shape {values.shape}, expected (N, {len(entries)}), N at least 1: "
            f"{', '.join(entries.names)}"
        )
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        raise InputError(
            f"{what}: member {bad[0][0]}, {entries[int(bad[0][1])].name!r} is not finite"
        )


def _with_unit_quaternions(mechanism: Mechanism, Q: Array) -> Array:
    """The coordinates with quaternions divided by their lengths, as `Mechanism.state` does."""
    result = Q.copy()
    for joint, place in mechanism.quaternions.items():
        length = np.sqrt(np.einsum("ij,ij->i", Q[:, place], Q[:, place]))
        bad = np.flatnonzero(np.abs(length - 1.0) > 1e-3)
        if len(bad):
            k = int(bad[0])
            raise StateError(
                f"states: member {k}: the quaternion of joint {joint!r}, {tuple(Q[k, place].tolist())}, "
                f"has length {length[k]:.6g}; expected a unit quaternion, scalar first. Divide it by its "
                "length"
            )
        # What is of unit length but for rounding keeps its bits.
        length[np.abs(length - 1.0) <= LENGTH_ROUNDING] = 1.0
        result[:, place] /= length[:, None]
    return result


def check_prescribed(
    mechanism: Mechanism, t: float, Q: Array, U: Array, names: Sequence[str], p: Array
) -> None:
    """InputError for the first member whose prescribed joints are not where their laws put them.

    By its own parameters, `p` (np, N) of `names`; within what `Mechanism.state` allows.
    """
    if not any(joint.prescribed for joint in mechanism.joints):
        return
    system = trace(mechanism, names)
    for actual, symbols, entries in (
        (Q, system.q_all, mechanism.coordinates),
        (U, system.u_all, mechanism.speeds),
    ):
        places = [k for k, entry in enumerate(entries) if entry.prescribed]
        law = ca.Function("law", [system.t, system.p], [symbols[places]])
        due, values = np.array(law(t, p)).T, actual[:, places]
        bad = np.argwhere(~(np.abs(values - due) <= 1e-6 * np.maximum(1.0, np.abs(due))))
        if len(bad):
            k, j = map(int, bad[0])
            due = np.broadcast_to(due, values.shape)
            raise StateError(
                f"states: member {k}: {entries[places[j]].name!r} is prescribed: its law gives "
                f"{due[k, j]:.9g} at t = {t:g}, the state says {values[k, j]:.9g}. Make it by "
                "mechanism.state(...), of the mechanism with the member's parameters"
            )
