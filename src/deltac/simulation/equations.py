"""Equations of motion written by hand, and controllers: Python functions in place of the model's own."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.dynamics.constraints import Rows
from deltac.dynamics.coordinates import OwnCoordinates, trace_map
from deltac.dynamics.equations_of_motion import evaluate_at
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.errors import InputError, StateError, UnknownName, WrongType, closest
from deltac.mechanism.coordinate_map import CoordinateMap


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of motion u̇ = rhs(t, q, u), in place of the mechanism's own.

    `rhs` takes the time and arrays q, u of shape (n,), or (n, B) with the batch last, and returns u̇
    likewise: in the coordinates and speeds of `coordinates`, or without a map in the mechanism's free
    ones (the prescribed joints follow their laws). With a map that leaves the rest to the constraints, such
    as ``CoordinateMap(("crank",))`` of a four-bar, they are equations in minimal coordinates.

    A function of arithmetic and NumPy's elementary functions is traced and compiled; any other (with
    branches, look-up tables, memory) is called from Python at every stage, more slowly. `compiled` = True
    insists on the former, False on the latter.
    """

    rhs: Callable[..., Any]
    coordinates: CoordinateMap | None = None
    name: str = "equations by hand"
    compiled: bool | None = None

    def __post_init__(self) -> None:
        if not callable(self.rhs):
            raise InputError(f"{self.name}: rhs is {self.rhs!r}, expected a function of (t, q, u)")

    def __call__(self, t: float, q: Array, u: Array) -> Array:
        """u̇ as a float array; InputError for a result of another shape."""
        value = np.asarray(self.rhs(t, q, u), dtype=np.float64)
        if value.shape != u.shape:
            raise InputError(
                f"{self.name}: rhs returned an array of shape {value.shape} for u of shape {u.shape}; "
                "expected u̇ in the shape of u"
            )
        return value


@dataclass(frozen=True, eq=False)
class Controller:
    """A Python function that sets motors: `function(t, q, u)` -> {name of joint torque: value}.

    q, u are the full vectors of the mechanism. The value (N·m or N; a sequence for a joint with several
    speeds) is held over a step of the solver if `hold`, else asked for at every stage.
    """

    function: Callable[[float, Array, Array], Mapping[str, Any]]
    hold: bool = True


def motor_values(controller: Controller, system: System, t: float, q: Array, u: Array) -> Array:
    """Values of all motors without a law, in the order of `System.inputs`.

    Raises InputError for a motor that is unknown or left out, and a value of wrong size or not finite.
    """
    answer = controller.function(t, q, u)
    places = system.input_places
    if not hasattr(answer, "items"):
        raise WrongType(
            f"the controller returned {type(answer).__name__}, expected a mapping of the names of "
            f"joint torques to values: {', '.join(places)}"
        )
    for name in answer:
        if name not in places:
            raise UnknownName(
                f"the controller sets an unknown joint torque {name!r}{closest(name, places)}"
            )
    values = np.empty(system.inputs.shape[0])
    for name, place in places.items():
        if name not in answer:
            raise InputError(f"the controller returned no value for joint torque {name!r}")
        value = np.atleast_1d(np.asarray(answer[name], dtype=np.float64))
        if value.shape != (place.stop - place.start,) or not np.isfinite(value).all():
            raise StateError(
                f"the controller returned {answer[name]!r} for joint torque {name!r} at t = {t:g}; "
                f"expected {place.stop - place.start} finite value(s)"
            )
        values[place] = value
    return values


@dataclass(frozen=True, eq=False)
class ByHand:
    """Hand-written equations as they are now: what the function reads, its constants too, is in `udot`.

    `q`, `u`, `qdot` are the coordinates, speeds and rates that the equations are written in, those of `own`
    where they have a map; `udot` is None for a function that is called from Python. `key` tells what may
    be kept: two calls of `simulate` share compiled code if and only if their expressions are the same, not
    because they were given the same function, whose constants may have changed in between.
    """

    equations: Equations
    own: OwnCoordinates | None
    q: SX
    u: SX
    qdot: SX
    udot: SX | None
    key: Hashable


def by_hand(system: System, equations: Equations, rows: Rows) -> ByHand:
    """Trace hand-written equations, now; `rows` are the mechanism's independent constraints."""
    own = None
    q, u, qdot = system.q, system.u, system.qdot
    key: Hashable = equations  # called anew at every stage: nothing of it is baked in
    if equations.coordinates is not None:
        own = trace_map(system, equations.coordinates, rows)
        q, u, qdot = own.own_q, own.own_u, own.own_qdot
        if own.told is not None:
            equations = replace(equations, rhs=_of_state(equations.rhs, system, own.told))
    udot = trace_rhs(equations, system.t, q, u)
    if udot is not None:
        expression = ca.Function("rhs", [system.t, q, u], [udot]).serialize()
        digest = hashlib.sha256(expression.encode()).digest()
        key = (digest, equations.coordinates, equations.name)
    return ByHand(equations, own, q, u, qdot, udot, key)


def _of_state(rhs: Callable[..., Any], system: System, told: SX) -> Callable[..., Any]:
    """A function of own coordinates as one of the mechanism's, which are functions `told` of (t, q)."""
    p = [system.mechanism.parameters[name] for name in system.vary]
    numbers = ca.Function("told", [system.t, system.q, system.p], [ca.densify(told)])

    def of_state(t: Any, q: Any, u: Any) -> Any:
        if np.asarray(q).dtype != object:
            return rhs(t, evaluate_at(numbers, t, q, p)[0], u)
        place = [t, ca.vertcat(*q)]
        return rhs(t, _objects(*ca.substitute([told], [system.t, system.q], place)), u)

    return of_state


def trace_rhs(equations: Equations, t: SX, q: SX, u: SX) -> SX | None:
    """The equations in symbols, or None when they cannot be (or do not want to be) traced.

    The traced expression is compared with the function itself at random states, so that a function
    that hides a branch or a memory is not mistaken for what it did once.
    """
    if equations.compiled is False:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # CasADi announces changes to come
            traced = equations.rhs(t, _objects(q), _objects(u))
        entries = [ca.SX(entry) for entry in np.asarray(traced, dtype=object).ravel()]
    except Exception as error:  # whatever a user's function raises on symbols
        if equations.compiled:
            raise InputError(
                f"{equations.name}: rhs cannot be traced ({type(error).__name__}: {error}); use only "
                "arithmetic and NumPy's elementary functions, or leave compiled=None"
            ) from error
        return None
    if len(entries) != u.shape[0]:
        raise InputError(
            f"{equations.name}: rhs returned {len(entries)} accelerations, expected {u.shape[0]}"
        )
    expression = ca.vertcat(*entries)
    if _agrees(equations, ca.Function("rhs", [t, q, u], [expression]), q.shape[0], u.shape[0]):
        return expression
    if equations.compiled:
        raise InputError(
            f"{equations.name}: rhs gives other values when traced than when called; it has a branch, "
            "a memory or a random element. Leave compiled=None"
        )
    return None


def _objects(column: SX) -> NDArray[Any]:
    """A column of symbols as a NumPy array of scalars, so that NumPy's functions act on each."""
    array = np.empty(column.shape[0], dtype=object)
    for k in range(column.shape[0]):
        array[k] = column[k]
    return array


def _agrees(equations: Equations, traced: Any, nq: int, nu: int) -> bool:
    rng = np.random.default_rng(20080614)
    for scale in (0.1, 1.0, 3.0):
        t, q, u = scale, scale * rng.standard_normal(nq), scale * rng.standard_normal(nu)
        with np.errstate(all="ignore"):
            called = equations(t, q.copy(), u.copy())
        symbolic = np.array(traced(t, q, u)).ravel()
        size = np.abs(called).max(initial=1.0)
        if not np.allclose(called, symbolic, rtol=1e-9, atol=1e-9 * size, equal_nan=True):
            return False
    return True
