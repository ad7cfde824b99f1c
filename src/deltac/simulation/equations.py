"""Equations of motion written by hand, and controllers: Python functions in place of the model's own."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltac.arrays import HALF_DIGITS, Array
from deltac.calls.arguments import checked
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.coordinates import OwnCoordinates, trace_map
from deltac.dynamics.equations_of_motion import equations_of
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.errors import InputError, SourceError, StateError, WrongType, check_names, listed, shown
from deltac.mechanism.coordinate_map import CoordinateMap, check_coordinates, own_coordinates
from deltac.simulation.state_form import (
    PLAIN_FORM,
    Order,
    StateForm,
    candidate_forms,
    likeliest,
    signature,
    state_names,
)
from deltac.trajectories.columns import QUATERNION

RightHandSide: TypeAlias = "Callable[..., ArrayLike | Sequence[object]]"
"""Equations as a function: of (t, q, u) or of a state vector; it returns u̇, or the rates of the state."""


@checked
@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of motion u̇ = rhs(t, q, u), in place of the mechanism's own.

    `rhs` takes the time and arrays q, u of shape (n,), or (n, B) with the batch last, and returns u̇
    likewise: in the coordinates and speeds of `coordinates` (a map, or "absolute" for absolute angles), or
    without it in the mechanism's free ones (the prescribed joints follow their laws). With a map that leaves
    the rest to the constraints, such as ``CoordinateMap(("crank",))`` for a four-bar, these are equations in
    minimal coordinates.

    A function of arithmetic and NumPy's elementary functions is traced and compiled; any other (with
    branches, look-up tables, memory) is called from Python at every stage, more slowly. `compiled` = True
    insists on the former, False on the latter.

    `rhs` may also be what SciPy's solvers take, a function of (t, y) or (y, t) that returns ẏ: `form` = "ode"
    says so; by default the names of the arguments decide. `order` names the entries of y, such as
    ``("a", "u.a", "b", "u.b")``, or is "interleaved" for that order. By default it is inferred from the
    returned rates q̇. These must follow from the speeds: deltac integrates the mechanism's own q̇ = W u.
    """

    rhs: RightHandSide
    coordinates: CoordinateMap | str | None = None
    name: str = "equations by hand"
    compiled: bool | None = None
    form: str | None = None
    order: Order = None

    def __post_init__(self) -> None:
        if isinstance(self.rhs, type) or not callable(self.rhs):
            remedy = "; give an object of the class" if isinstance(self.rhs, type) else ""
            raise WrongType(
                f"{self.name}: rhs is {shown(self.rhs)}, expected a function of (t, q, u){remedy}"
            )
        check_coordinates(self.coordinates)
        if self.form not in (None, "ode"):
            raise InputError(
                f"{self.name}: form is {self.form!r}; expected 'ode' for a function of (t, y) that returns "
                "ẏ, or None for one of (t, q, u) that returns u̇"
            )

    def __call__(self, t: float, q: Array, u: Array) -> Array:
        """u̇ as a float array; InputError for a result of another shape."""
        value = np.asarray(self.rhs(t, q, u), dtype=np.float64)
        if value.shape != u.shape:
            raise SourceError(
                f"{self.name}: rhs returned an array of shape {value.shape} for u of shape {u.shape}; "
                "expected u̇ in the shape of u"
            )
        return value


def as_equations(equations: Equations | RightHandSide) -> Equations:
    """Equations as they are, or those of a bare function, which gives them its name."""
    if isinstance(equations, Equations):
        return equations
    return Equations(equations, name=str(getattr(equations, "__name__", "equations by hand")))


@dataclass(frozen=True, eq=False)
class StateSymbols:
    """The state in which equations are written, in symbols of a traced system.

    `q`, `u`, `qdot` are the coordinates, speeds and rates: the mechanism's free ones, or those of `own` where
    there is a map. A function takes the coordinates `user_q`, with rates `user_rate`, and the speeds, named
    `coordinates` and `speeds`: those of the state, or own ones that give the others only by assembly.
    """

    own: OwnCoordinates | None
    q: SX
    u: SX
    qdot: SX
    user_q: SX
    user_rate: SX
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]


def state_symbols(
    system: System, coordinates: CoordinateMap | str | None, rows: ConstraintRows | None = None
) -> StateSymbols:
    """The state of a system's equations; InputError for a map that does not fit.

    `rows` are the mechanism's independent constraints, all of them by default.
    """
    coordinate_map = own_coordinates(system.mechanism, coordinates)
    names = tuple(system.mechanism.coordinates[i].name for i in system.free_q)
    speeds = tuple(system.mechanism.speeds[i].name for i in system.free_u)
    if coordinate_map is None:
        q, qdot = system.q, system.qdot
        return StateSymbols(None, q, system.u, qdot, q, qdot, names, speeds)
    own = trace_map(system, coordinate_map, equations_of(system).rows if rows is None else rows)
    names = coordinate_map.coordinates if own.mapped or own.user_q is not None else names
    own_q = own.own_q if own.user_q is None else own.user_q
    return StateSymbols(
        own,
        own.own_q,
        own.own_u,
        own.own_qdot,
        own_q,
        own.user_rate(system),
        names,
        coordinate_map.speeds or names,
    )


@dataclass(frozen=True, eq=False)
class _Explicit:
    """A function of a state vector as one of (t, q, u) that returns u̇; of symbols and batches, too."""

    rhs: Callable[..., Any]
    form: StateForm
    nq: int
    nu: int

    def __call__(self, t: Any, q: Any, u: Any) -> Any:
        answer = self.rhs(*self.form.given(t, q, u, np.array, 0.0))
        return np.array(self.form.split(list(np.ravel(answer)), self.nq, self.nu)[1])

    @property
    def __code__(self) -> Any:  # where messages look for the user's line
        return getattr(self.rhs, "__code__", None)


def explicit(system: System, equations: Equations) -> Equations:
    """The equations as u̇ = rhs(t, q, u), however their function takes the state.

    How it does is found out from its arguments and from the rates q̇ that it returns at some states.

    Raises InputError where it takes no state of this size, or returns other rates than those of the speeds.
    """
    parameters = signature(equations.rhs)
    declared = equations.form is not None or equations.order is not None
    if not declared and (parameters is None or parameters[1] >= len(PLAIN_FORM.arguments)):
        return equations
    state = state_symbols(system, equations.coordinates)
    coordinates, speeds = state.coordinates, state.speeds
    nq, nu = len(coordinates), len(speeds)
    place = [system.t, state.q, state.u]
    own_state = ca.Function("user_q", place, [state.user_q, state.user_rate])
    names = coordinates
    if state.own is not None and state.own.user_q is not None:  # the state holds the mechanism's
        names = tuple(system.mechanism.coordinates[i].name for i in system.free_q)
    drawn = _some_states(names, nu)
    values = [[np.array(x).ravel() for x in own_state(*at)] for at in drawn]
    states = [(t, y, u) for (t, _, u), (y, _) in zip(drawn, values)]
    right = np.array([rate for _, rate in values]).T

    def evaluate(form: StateForm) -> tuple[Array, Array]:
        answer = []
        for at, position, speed in states:
            arguments = form.given(at, position.copy(), speed.copy(), np.array, 0.0)
            with np.errstate(all="ignore"):
                value = np.asarray(equations.rhs(*arguments), dtype=np.float64)
            if form.column and value.ndim == 2:
                value = value.ravel()
            if value.ndim != 1:
                raise ValueError(f"it returns an array of shape {value.shape}")
            answer.append(np.array(sum(form.split(list(value), nq, nu), [])))
        table = np.array(answer).T
        return (table[:nq], table[nq:]) if len(table) > nu else (table[:0], table)

    motors = len(system.mechanism.motors)
    candidates = candidate_forms(
        parameters, equations.form, equations.order, coordinates, speeds, motors
    )
    form = likeliest(candidates, evaluate, right, np.empty((0, len(states))))
    if form is None or form.plain:
        if form is None and (
            declared or len(parameters[0] if parameters else ()) < len(PLAIN_FORM.arguments)
        ):
            raise _no_form(equations, candidates, evaluate, nq, nu)
        return equations  # called as it is: its own error says what does not fit
    answer, _ = evaluate(form)
    size = np.abs(right).max(axis=1, initial=0.0) + 1e-300
    wrong = [
        f"{name} ({answer[k, 0]:.6g} where its speed is {right[k, 0]:.6g})"
        for k, name in enumerate(coordinates)
        if len(answer) and not np.abs(answer[k] - right[k]).max() <= HALF_DIGITS * size[k]
    ]
    if wrong:
        raise SourceError(
            f"{equations.name}, taken as {form.describe(coordinates, speeds)}, returns rates that are not "
            f"those of the speeds: {listed(wrong)}. If y is in another order, say so: "
            f"deltac.Equations(f, form='ode', order={tuple(state_names(coordinates, speeds))}) with the "
            "names in the order of y; if not, deltac.check_equations(model, f) says which rates are wrong"
        )
    return replace(equations, rhs=_Explicit(equations.rhs, form, nq, nu), form=None, order=None)


def _no_form(
    equations: Equations,
    candidates: Sequence[StateForm],
    evaluate: Callable[[StateForm], Any],
    nq: int,
    nu: int,
) -> InputError:
    """Why a function that is said to be ẏ = f(t, y) cannot be called so."""
    why = f"its arguments are {signature(equations.rhs)}"
    for form in [one for one in candidates if one.order][:1]:
        try:
            evaluate(form)
        except ValueError as error:
            why = str(error)
        except Exception as error:  # whatever a function of a user raises
            why = f"{type(error).__name__}: {error}"
    return SourceError(
        f"{equations.name}: called with a state y of {nq} coordinates and {nu} speeds it does not return "
        f"{nq + nu} rates ({why}); expected a function of (t, y) that returns ẏ, as SciPy's solve_ivp takes"
    )


def _some_states(coordinates: Sequence[str], nu: int) -> list[tuple[float, Array, Array]]:
    """States to try a function at: quaternions of length one, nothing near zero alone."""
    rng = np.random.default_rng(2011)
    states = []
    for k in range(4):
        q = rng.uniform(-1.0, 1.0, len(coordinates))
        for place, name in enumerate(coordinates):
            if name.rpartition(".")[2] == QUATERNION[0]:
                part = slice(place, place + 4)
                q[part] /= np.linalg.norm(q[part])
        states.append((0.1 + 0.3 * k, q, rng.uniform(-1.0, 1.0, nu)))
    return states


@checked
@dataclass(frozen=True, eq=False)
class Controller:
    """A Python function that drives motors: `function(t, q, u)` -> {name of joint torque: value}.

    q, u are the full vectors of the mechanism. The value (N·m or N; a sequence for a joint with several
    speeds) is held over a step of the solver if `hold`, and evaluated at every stage otherwise.
    """

    function: Callable[[float, Array, Array], Mapping[str, ArrayLike]]
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
    check_names(answer, places, "the controller sets an unknown joint torque")
    values = np.empty(system.inputs.shape[0])
    for name, place in places.items():
        if name not in answer:
            raise SourceError(f"the controller returned no value for joint torque {name!r}")
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

    `state` is what they are written in; `udot` is None for a function that is called from Python. `key` tells
    what may be kept: two calls of `simulate` share compiled code if and only if their expressions are the
    same, not because they were given the same function, whose constants may have changed in between.
    """

    equations: Equations
    state: StateSymbols
    udot: SX | None
    key: Hashable


def by_hand(system: System, equations: Equations, rows: ConstraintRows | None = None) -> ByHand:
    """Trace hand-written equations, now; `rows` are the mechanism's independent constraints."""
    key: Hashable = equations  # called anew at every stage: nothing of it is baked in
    equations = explicit(system, equations)
    state = state_symbols(system, equations.coordinates, rows)
    y = state.q if state.user_q is state.q else ca.SX.sym("y", state.user_q.shape[0])
    udot = trace_rhs(equations, system.t, y, state.u)
    if udot is not None:
        expression = ca.Function("rhs", [system.t, y, state.u], [udot]).serialize()
        digest = hashlib.sha256(expression.encode()).digest()
        key = (digest, equations.coordinates, equations.name)
        udot = ca.substitute(udot, y, state.user_q)
    return ByHand(equations, state, udot, key)


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
            raise SourceError(
                f"{equations.name}: rhs cannot be traced ({type(error).__name__}: {error}); use only "
                "arithmetic and NumPy's elementary functions, or leave compiled=None"
            ) from error
        return None
    if len(entries) != u.shape[0]:
        raise SourceError(
            f"{equations.name}: rhs returned {len(entries)} accelerations, expected {u.shape[0]}"
        )
    expression = ca.vertcat(*entries)
    if _agrees(equations, ca.Function("rhs", [t, q, u], [expression]), q.shape[0], u.shape[0]):
        return expression
    if equations.compiled:
        raise SourceError(
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
