"""What an ensemble is made of: members' states, steps, solvers and parameters, checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltac.errors import InputError, closest
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.solvers import Solver, find_solver

Array = NDArray[np.float64]


def member_count(**sizes: int) -> int:
    """How many members there are, of the sizes of what was given; InputError where they differ."""
    if len(set(sizes.values()) - {1}) > 1:
        told = ", ".join(f"{name} has {size}" for name, size in sizes.items() if size > 1)
        raise InputError(f"members differ in number: {told}; expected one number N, or 1")
    return max(sizes.values())


def repeated(values: Array, members: int, axis: int) -> Array:
    """What all members share, once for each of them."""
    return values if values.shape[axis] == members else np.repeat(values, members, axis)


def member_steps(step: ArrayLike, duration: float) -> Array:
    """Steps (N,) or (1,), made to divide the duration exactly."""
    h = np.atleast_1d(np.asarray(step, dtype=np.float64))
    if h.ndim != 1 or not np.isfinite(h).all() or not (h > 0).all():
        raise InputError(f"step {step!r}: expected a positive number of seconds, or an array (N,)")
    counts = np.rint(duration / h)
    for size, count in zip(h, counts):
        if count < 1 or abs(count * size - duration) > 1e-9 * duration:
            raise InputError(f"step {size:g} does not divide the duration {duration:g}")
    return np.asarray(duration / counts)


def member_solvers(solver: str | Sequence[str]) -> list[Solver]:
    """The explicit fixed-step solvers of those names; InputError for any other."""
    found = [find_solver(name) for name in ([solver] if isinstance(solver, str) else solver)]
    for one in found:
        if one.family != "fixed":
            raise InputError(
                f"ensembles take explicit fixed steps, {one.name!r} does not; use 'ode5' or 'ode8'"
            )
    return found


def record_grid(h: Array, duration: float, every: int | None) -> tuple[float, int]:
    """The time between records and their number, not counting the start."""
    longest = float(h.max())
    steps = round(duration / longest)
    every = steps if every is None else every
    if every < 1 or steps % every:
        raise InputError(f"record_every {every} does not divide the number of steps, {steps}")
    records = steps // every
    interval = duration / records
    for size in set(h.tolist()):
        count = interval / size
        if abs(count - round(count)) > 1e-9 * count:
            raise InputError(
                f"step {size:g} does not divide the time between records, {interval:g} s; choose "
                "record_every so that all steps do"
            )
    return interval, records


def member_parameters(
    mechanism: Mechanism, vary: Mapping[str, ArrayLike], sensitivity: Sequence[str]
) -> tuple[list[str], Array]:
    """Names and values (n, N) of the parameters kept as symbols; those of `sensitivity` come last."""
    if isinstance(sensitivity, str) or len(set(sensitivity)) < len(sensitivity):
        raise InputError(f"sensitivity={sensitivity!r}: expected names of parameters, each once")
    for what, wanted in (("vary", vary), ("sensitivity", sensitivity)):
        for name in wanted:
            if name not in mechanism.parameters:
                raise InputError(
                    f"{what}: unknown parameter {name!r}{closest(name, mechanism.parameters)}"
                )
    names = [name for name in vary if name not in sensitivity] + list(sensitivity)
    columns = []
    for name in names:
        given = vary.get(name, mechanism.parameters[name])
        try:
            values = np.atleast_1d(np.asarray(given, dtype=np.float64))
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.ndim != 1 or not values.size or not np.isfinite(values).all():
            raise InputError(
                f"vary: the values of {name!r} are {given!r}; expected finite numbers, an array (N,)"
            )
        columns.append(values)
    if len({len(c) for c in columns} - {1}) > 1:
        sizes = {name: len(c) for name, c in zip(names, columns)}
        raise InputError(f"vary: the parameters differ in their number of members: {sizes}")
    count = max((len(c) for c in columns), default=1)
    table = np.array([np.broadcast_to(c, count) for c in columns]).reshape(len(names), count)
    _check_extremes(mechanism, names, table)
    return names, table


def _check_extremes(mechanism: Mechanism, names: Sequence[str], table: Array) -> None:
    """InputError if the members with a parameter's least or largest value are no mechanisms."""
    for values in table:
        for k in {int(values.argmin()), int(values.argmax())}:
            member = dict(zip(names, map(float, table[:, k])))
            try:
                mechanism.with_parameters(**member)
            except InputError as error:
                told = ", ".join(f"{name} = {value:g}" for name, value in member.items())
                raise InputError(f"vary: member {k} ({told}): {error}") from None


def member_states(
    mechanism: Mechanism, states: State | tuple[ArrayLike, ArrayLike]
) -> tuple[float, Array, Array]:
    """Start time, Q (N, nq), U (N, nu), checked; N = 1 for a state that all share."""
    if isinstance(states, State):
        return states.t, states.q[None, :], states.u[None, :]
    Q, U = (np.atleast_2d(np.asarray(values, dtype=np.float64)) for values in states)
    for what, values, entries in (("Q", Q, mechanism.coordinates), ("U", U, mechanism.speeds)):
        if values.ndim != 2 or values.shape[1] != len(entries):
            raise InputError(
                f"{what} has shape {values.shape}, expected (N, {len(entries)}): {', '.join(entries.names)}"
            )
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            raise InputError(
                f"{what}: member {bad[0][0]}, {entries[int(bad[0][1])].name!r} is not finite"
            )
    if len(Q) != len(U):
        raise InputError(f"Q has {len(Q)} members, U has {len(U)}")
    return 0.0, Q, U
