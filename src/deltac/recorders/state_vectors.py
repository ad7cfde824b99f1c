"""Runs of general ODE solvers as trajectories: SciPy's results, and states y(t) as bare arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import SAME, Array, max_norm
from deltac.dynamics import System, trace
from deltac.errors import LogError, ModelError, WrongType, closest
from deltac.mechanism import CoordinateMap, Mechanism
from deltac.models import ModelLike, load_model
from deltac.simulation import (
    Equations,
    Order,
    RightHandSide,
    StateSymbols,
    as_equations,
    declared_order,
    explicit,
    state_names,
    state_symbols,
    usual_orders,
)
from deltac.trajectories import (
    INTERPOLATED,
    ROWS,
    Movement,
    Provenance,
    SolverResult,
    Trajectory,
    preferred,
)

AT_ROWS = "accelerations: the equations that were integrated, at each row"


def is_solver_result(source: Any) -> bool:
    """Whether this is what an ODE solver returns: t and y (SciPy), ts and ys (diffrax), or a pair (t, y)."""
    if isinstance(source, tuple | list):
        return len(source) == 2 and [np.ndim(part) for part in source] == [1, 2]
    return any(hasattr(source, a) and hasattr(source, b) for a, b in (("t", "y"), ("ts", "ys")))


def trajectory_of_states(
    source: SolverResult,
    model: ModelLike,
    *,
    order: Order = None,
    coordinates: CoordinateMap | str | None = None,
    equations: Equations | RightHandSide | None = None,
    provenance: Provenance | None = None,
) -> Trajectory:
    """The trajectory of a solver's states, see `Trajectory.from_scipy`."""
    loaded = load_model(model)
    mechanism = loaded.mechanism
    own_equations = None if equations is None else as_equations(equations)
    chosen = loaded.coordinate_map(coordinates, own_equations)
    if own_equations is not None and order is None:
        order = own_equations.order
    system = trace(mechanism)
    symbols = _complete(state_symbols(system, chosen), mechanism)
    names = state_names(symbols.coordinates, symbols.speeds)
    t, y, source_facts = _states(source, len(names))
    if y.shape != (len(t), len(names)):
        raise LogError(
            f"the result has {len(t)} times and states of shape {y.shape}; mechanism {mechanism.name!r} has "
            f"a state of {len(names)} entries: {', '.join(names)}"
        )
    if order is None:
        places = _likely_order(system, symbols, t, y)
    else:
        places = declared_order(order, symbols.coordinates, symbols.speeds)
    state = np.empty_like(y)
    state[:, list(places)] = y
    q, u = np.split(state, [len(symbols.coordinates)], axis=1)
    udot = None
    if own_equations is not None:
        rhs = explicit(
            system,
            Equations(
                own_equations.rhs, chosen, own_equations.name, form=own_equations.form, order=order
            ),
        )
        udot = np.array([rhs(time, *(x.copy() for x in at)) for time, *at in zip(t, q, u)])
        source_facts = replace(source_facts, equations=own_equations.name, stage=AT_ROWS)
    full = _full(system, symbols)(t, q, u, np.zeros_like(u) if udot is None else udot)
    return Trajectory(
        t=t,
        q=full[0],
        u=full[1],
        udot=None if udot is None else full[2],
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
        provenance=provenance or source_facts,
    )


def in_joint_coordinates(run: Trajectory, mechanism: Mechanism, own: CoordinateMap) -> Trajectory:
    """A run whose columns hold own coordinates and speeds, in those of the mechanism's joints.

    Forces stay as they are: a force is logged by the joint or body that it acts on.

    Raises InputError for a map that does not fit, and columns that are not those of the map.
    """
    system = trace(mechanism)
    symbols = _complete(state_symbols(system, own), mechanism)
    udot = np.zeros_like(run.u) if run.udot is None else run.udot
    columns = []
    for what, names, expected, values in (
        ("coordinate", run.coordinates, symbols.coordinates, run.q),
        ("speed", run.speeds, symbols.speeds, run.u),
        ("speed", run.speeds, symbols.speeds, udot),
    ):
        missing = [name for name in expected if name not in names]
        if missing:
            raise LogError(
                f"coordinates: the log has no {what} {missing[0]!r} of the map{closest(missing[0], names)}"
            )
        columns.append(values[:, [names.index(name) for name in expected]])
    q, u, rates = _full(system, symbols)(run.t, *columns)
    return replace(
        run,
        q=q,
        u=u,
        udot=None if run.udot is None else rates,
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
    )


def _complete(symbols: StateSymbols, mechanism: Mechanism) -> StateSymbols:
    """The state of a map that has laws for all joints; InputError for one that leaves some to assembly."""
    if symbols.own is not None and symbols.own.user_q is not None:
        raise ModelError(
            f"coordinates: {', '.join(symbols.coordinates)} leave the other joints of {mechanism.name!r} to "
            "assembly, which the result or log does not hold; let deltac.simulate(model, equations=...) "
            "integrate these equations, or give a map with laws for all joints"
        )
    return symbols


def _states(source: Any, width: int) -> tuple[Array, Array, Provenance]:
    """Times (T,), states (T, n) and what the result says of its solver."""
    if not is_solver_result(source):
        raise WrongType(
            f"log: found {type(source).__name__}, expected a Trajectory, the path of a log, a table "
            "(dictionary of arrays, DataFrame, xarray Dataset), the result of "
            "scipy.integrate.solve_ivp, or a pair (t, y) of times (T,) and states (T, n)"
        )
    if isinstance(source, tuple | list):
        t, y = source
        source_facts = Provenance("unknown")
    elif hasattr(source, "ts"):
        t, y, source_facts = source.ts, source.ys, Provenance("diffrax")
    else:
        t, y = source.t, np.asarray(source.y, dtype=np.float64).T
        completed = bool(getattr(source, "success", True))
        message = "" if completed else str(getattr(source, "message", ""))
        source_facts = Provenance("SciPy", completed=completed, message=message)
        dense = getattr(source, "sol", None)
        if dense is not None and not np.array_equal(
            t, dense.ts
        ):  # its own steps say more than t_eval's rows
            t = dense.ts
            y = dense(t).T
        source_facts = replace(source_facts, notes=_between(np.asarray(t, dtype=np.float64)))
    t, y = np.asarray(t, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if t.ndim == 1 and y.shape == (width, len(t)) and width != len(t):
        y = y.T  # as solve_ivp has it
    if len(t) > 1 and t[-1] < t[0]:  # integrated backwards
        t, y = t[::-1], y[::-1]
    return t, y, source_facts


def _between(t: Array) -> dict[str, str]:
    """A note that rows lie between the steps of the solver, where their times show it."""
    h = np.diff(t)
    even = len(h) > 2 and float(np.ptp(h)) <= SAME * max_norm(h)
    return {ROWS: INTERPOLATED} if even else {}


def _full(system: System, symbols: StateSymbols) -> Callable[..., Sequence[Array]]:
    """From rows of (t, q, u, u̇) of the state to q, u, u̇ of all joints."""
    accelerations = ca.SX.sym("udot", symbols.u.shape[0])
    outputs = [ca.SX(x) for x in (system.q_all, system.u_all, system.udot_all)]
    own = symbols.own
    outputs = ca.substitute(
        outputs, [system.udot], [accelerations if own is None else own.udot(system, accelerations)]
    )
    if own is not None:
        outputs = ca.substitute(outputs, [system.q, system.u], [own.q, own.u])
    inputs = [system.t, symbols.q, symbols.u, accelerations]
    function = ca.Function("full", inputs, [ca.densify(x) for x in outputs])

    def rows(*columns: Array) -> list[Array]:
        values = function.map(len(columns[0]))(*(np.atleast_2d(x.T) for x in columns))
        return [np.array(x).T for x in values]

    return rows


def _likely_order(system: System, symbols: StateSymbols, t: Array, y: Array) -> tuple[int, ...]:
    """The usual order in which the coordinates move as their rates say.

    Raises InputError where none does.
    """
    names = state_names(symbols.coordinates, symbols.speeds)
    nq, nu = len(symbols.coordinates), len(symbols.speeds)
    rates = ca.Function("rates", [system.t, symbols.q, symbols.u], [ca.densify(symbols.qdot)])
    movements: dict[tuple[int, ...], Movement] = {}
    for order in usual_orders(nq, nu):
        state = np.empty_like(y)
        state[:, list(order)] = y
        q, u = np.split(state, [nq], axis=1)
        movements[order] = Movement.of(t, q, np.array(rates.map(len(t))(t[None], q.T, u.T)).T)

    def miss(order: tuple[int, ...]) -> float:
        size, difference = movements[order].sizes()
        return difference / size if size else 0.0

    best = preferred(list(movements), miss) if len(t) > 2 else min(movements, key=miss)
    if best is None:
        least = min(map(miss, movements))
        raise LogError(
            f"in none of the usual orders of the state do the coordinates move as their speeds say (off by "
            f"{least:.0%}). Say which entry of y is what: deltac.Trajectory.from_scipy(result, model, "
            f"order={tuple(names)!r}), in the order of y; or ask for more samples (t_eval=…)"
        )
    return best
