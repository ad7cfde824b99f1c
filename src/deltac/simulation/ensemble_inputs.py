"""What an ensemble is made of: members' steps, solvers and parameters, checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import Array
from deltac.errors import InputError, closest
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.preparation import count, whole_steps
from deltac.simulation.solvers import Solver, find_solver


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
    h = np.atleast_1d(_numbers(step))
    if h.ndim != 1 or not h.size or not np.isfinite(h).all() or not (h > 0).all():
        raise InputError(f"step {step!r}: expected a positive number of seconds, or an array (N,)")
    exact = {size: duration / whole_steps(duration, size, 1) for size in set(h.tolist())}
    return np.array([exact[size] for size in h.tolist()])


def member_solvers(solver: str | Sequence[str]) -> list[Solver]:
    """The explicit fixed-step solvers of those names; InputError for any other."""
    names = [solver] if isinstance(solver, str) or not isinstance(solver, Iterable) else [*solver]
    if not names:
        raise InputError(f"solver is {solver!r}; expected a name, or N of them")
    found = [find_solver(name) for name in names]
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
    every = steps if every is None else count(every, "record_every")
    if steps % every:
        raise InputError(f"record_every {every} does not divide the number of steps, {steps}")
    records = steps // every
    interval = duration / records
    for size in set(h.tolist()):
        between = interval / size
        if abs(between - round(between)) > 1e-9 * between:
            raise InputError(
                f"step {size:g} does not divide the time between records, {interval:g} s; choose "
                "record_every so that all steps do"
            )
    return interval, records


def member_parameters(
    mechanism: Mechanism, vary: Mapping[str, ArrayLike], sensitivity: Sequence[str]
) -> tuple[list[str], Array]:
    """Names and values (n, N) of the parameters kept as symbols; those of `sensitivity` come last."""
    if not isinstance(vary, Mapping):
        raise InputError(
            f"vary is {vary!r}; expected values (N,) by name, such as {{'m': [1.0, 2.0]}}. Names alone are "
            "for `simulate`, where they say what stays a parameter of the compiled code"
        )
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
        values = np.atleast_1d(_numbers(given))
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


def _numbers(given: object) -> Array:
    """An array of what was given; an empty one if these are no numbers."""
    try:
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)


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
