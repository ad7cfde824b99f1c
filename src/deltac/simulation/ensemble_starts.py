"""Where the members of an ensemble start: their states, read and checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import Array
from deltac.dynamics.system import trace
from deltac.errors import InputError
from deltac.mechanism.coordinates import Entries
from deltac.mechanism.joints import KINDS
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State

ROUNDING = 1e-15
"""A quaternion's length differs from one by so little after a division by it."""

States: TypeAlias = State | Sequence[State] | tuple[ArrayLike, ArrayLike]


def member_states(mechanism: Mechanism, states: States) -> tuple[float, Array, Array]:
    """Start time, Q (N, nq), U (N, nu), of finite values, quaternions of unit length.

    N = 1 for a state that all share.
    """
    given = [states] if isinstance(states, State) else states
    if not isinstance(given, list | tuple) or not given:
        raise InputError(f"states: found {_told(states)}; {_EXPECTED}")
    if any(isinstance(one, State) for one in given):
        t, Q, U = _gathered(mechanism, given)
    elif len(given) == 2:
        t, Q, U = 0.0, *(_array(what, values) for what, values in zip("QU", given))
    else:
        raise InputError(
            f"states: found a {type(given).__name__} of {len(given)} entries; {_EXPECTED}"
        )
    _check_values("Q", Q, mechanism.coordinates)
    _check_values("U", U, mechanism.speeds)
    if len(Q) != len(U):
        raise InputError(f"Q has {len(Q)} members, U has {len(U)}")
    return t, _with_unit_quaternions(mechanism, Q), U


_EXPECTED = "expected a State, a sequence of States, or (Q, U) of shapes (N, nq) and (N, nu)"


def _told(given: object) -> str:
    shape = getattr(given, "shape", None)
    return type(given).__name__ if shape is None else f"one array of shape {shape}"


def _gathered(mechanism: Mechanism, states: Sequence[object]) -> tuple[float, Array, Array]:
    """The common time of states, and their coordinates and speeds by rows."""
    nq, nu = len(mechanism.coordinates), len(mechanism.speeds)
    found: list[State] = []
    for k, state in enumerate(states):
        if not isinstance(state, State):
            raise InputError(
                f"states: member {k} is of type {type(state).__name__}; expected a State, as others"
            )
        if state.q.shape != (nq,) or state.u.shape != (nu,):
            raise InputError(
                f"states: member {k} has {state.q.size} coordinates and {state.u.size} speeds; the "
                f"mechanism {mechanism.name!r} has {nq} and {nu}. Make it by mechanism.state(...)"
            )
        if found and state.t != found[0].t:
            raise InputError(
                f"states: member {k} starts at t = {state.t:g} s, member 0 at {found[0].t:g} s; expected one "
                "time for all"
            )
        found.append(state)
    return found[0].t, np.array([s.q for s in found]), np.array([s.u for s in found])


def _array(what: str, values: ArrayLike) -> Array:
    try:
        return np.atleast_2d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
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
    for joint in mechanism.joints:
        offset = KINDS[joint.kind].quaternion
        if offset is None:
            continue
        start = mechanism.coordinates.of(joint.name).start + offset
        place = slice(start, start + 4)
        length = np.sqrt(np.einsum("ij,ij->i", Q[:, place], Q[:, place]))
        bad = np.flatnonzero(np.abs(length - 1.0) > 1e-3)
        if len(bad):
            k = int(bad[0])
            raise InputError(
                f"states: member {k}: the quaternion of joint {joint.name!r}, {tuple(Q[k, place].tolist())}, "
                f"has length {length[k]:.6g}; expected a unit quaternion, scalar first. Divide it by its "
                "length"
            )
        # What is of unit length but for rounding keeps its bits.
        length[np.abs(length - 1.0) <= ROUNDING] = 1.0
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
    for given, symbols, entries in (
        (Q, system.q_all, mechanism.coordinates),
        (U, system.u_all, mechanism.speeds),
    ):
        places = [k for k, entry in enumerate(entries) if entry.prescribed]
        law = ca.Function("law", [system.t, system.p], [symbols[places]])
        due, found = np.array(law(t, p)).T, given[:, places]
        bad = np.argwhere(~(np.abs(found - due) <= 1e-6 * np.maximum(1.0, np.abs(due))))
        if len(bad):
            k, j = map(int, bad[0])
            due = np.broadcast_to(due, found.shape)
            raise InputError(
                f"states: member {k}: {entries[places[j]].name!r} is prescribed: its law gives "
                f"{due[k, j]:.9g} at t = {t:g}, the state says {found[k, j]:.9g}. Make it by "
                "mechanism.state(...), of the mechanism with the member's parameters"
            )
