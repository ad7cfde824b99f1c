"""Adaptive solvers: SciPy's, on the compiled ẋ, and heyoka's Taylor method in double and quad."""

from __future__ import annotations

import copy
import math
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.equations_of_motion import quaternions
from deltac.errors import InputError
from deltac.kernels import Kernel
from deltac.mechanism.laws import is_smooth
from deltac.simulation.course import Motion, Progress
from deltac.simulation.equations import Controller
from deltac.simulation.flow import Flow
from deltac.simulation.solvers.solver import Solver
from deltac.simulation.stages import Settle, StageRate

IMPLICIT = ("Radau", "BDF", "LSODA")
KINKED = (
    "FABS",
    "SIGN",
    "FMIN",
    "FMAX",
    "LT",
    "LE",
    "EQ",
    "NE",
    "NOT",
    "AND",
    "OR",
    "FLOOR",
    "CEIL",
    "FMOD",
    "COPYSIGN",
    "IF_ELSE_ZERO",
)


def run_scipy(
    flow: Flow,
    solver: Solver,
    controller: Controller | None,
    p: Array,
    x0: Array,
    times: Array | None,
    span: tuple[float, float],
    tolerance: float,
    progress: Progress | None,
) -> Motion:
    """Integrate over `span`; samples at `times` by dense output, or at the solver's own steps."""
    from scipy import integrate

    rate = StageRate(flow, controller, p)

    def f(t: float, x: Array) -> Array:
        return rate(t, x)

    options = scipy_options(tolerance)
    if solver.name in IMPLICIT and flow.traced and controller is None:
        options["jac"] = _jacobian(flow, p)
    method = getattr(integrate, solver.name)(f, span[0], x0, span[1], **options)
    kept_t, kept_x, message = [span[0]], [x0.copy()], ""
    following, settle = 1, Settle(flow, p)
    while method.status == "running":
        before = method.t
        with np.errstate(all="ignore"):
            problem = method.step()
        # LSODA goes on with steps of no length for ever where the others give up.
        stuck = method.status == "running" and method.t - before < 10 * np.spacing(before)
        if flow.projecting and method.status != "failed":
            method.y, _ = settle(method.t, method.y)
            method.f = f(method.t, method.y)
        if method.status == "failed" or stuck or not np.isfinite(method.y).all():
            reason = "the steps became too small" if stuck else "the state is not finite"
            message = (
                f"stopped at t = {kept_t[-1]:.9g} s: {problem or reason}; "
                "what was computed so far is kept"
            )
            break
        if times is None:
            kept_t.append(method.t)
            kept_x.append(method.y.copy())
        elif following < len(times) and times[following] <= method.t:
            dense = method.dense_output()
            while following < len(times) and times[following] <= method.t:
                kept_t.append(times[following])
                kept_x.append(settle(times[following], dense(times[following]))[0])
                following += 1
        if progress is not None:
            progress((method.t - span[0]) / (span[1] - span[0]))
    x = np.array(kept_x)
    if flow.own is None:
        for place in quaternions(flow.system.mechanism):
            x[:, place] /= np.linalg.norm(x[:, place], axis=1, keepdims=True)
    inputs = np.array([rate.hold(t, state) for t, state in zip(kept_t, x)])
    return Motion(np.array(kept_t), x, inputs, message)


def scipy_options(tolerance: float) -> dict[str, Any]:
    """Tolerances as SciPy's methods want them."""
    return {"rtol": max(tolerance, 1e-13), "atol": 1e-3 * tolerance}


def _jacobian(flow: Flow, p: Array) -> Any:
    """∂ẋ/∂x, exact and compiled, for implicit methods."""
    kernel = Kernel(
        {"t": flow.t, "x": flow.x}, {"J": ca.jacobian(flow.xdot, flow.x)}, flow.p, name="jacobian"
    )
    return lambda t, x: kernel(t=t, x=x, parameters=p)["J"][0]


def run_taylor(
    flow: Flow,
    p: Array,
    x0: Array,
    times: Array,
    tolerance: float | None,
    progress: Progress | None,
    *,
    quad: bool,
) -> Motion:
    """Integrate by heyoka's adaptive Taylor method; its order follows from the tolerance.

    The default tolerance is the precision of the numbers, double or quadruple. Refuses laws that are
    not smooth.
    """
    _require_smooth(flow)
    try:
        import heyoka as hy
    except ImportError:
        raise InputError(
            "solver 'taylor' needs heyoka, which is not installed here; use 'DOP853' with tolerance=1e-13"
        ) from None
    real = hy.real128 if quad else float
    # A copy for each run: threads may run the same mechanism at once.
    method = copy.copy(_taylor_method(flow, tuple(p.tolist()), tolerance, real))
    method.state[:], method.time = x0.astype(real), real(times[0])
    states: list[Array] = [x0[None, :]]
    message = ""
    places = [] if flow.own is not None else quaternions(flow.system.mechanism)
    first = _first_step(method, x0, times, real)
    for start in (0, *range(1, len(times) - 1, 256)):
        grid = times[:2] if start == 0 else times[start : start + 257]
        limit = {"max_delta_t": real(first)} if start == 0 else {}
        outcome = method.propagate_grid(grid.astype(real), **limit)
        found = np.asarray(outcome[-1]).astype(np.float64)
        good = np.isfinite(found).all(axis=1)
        count = len(grid) if good.all() and len(found) == len(grid) else int(np.argmin(good))
        states.append(found[1:count])
        if count < len(grid):
            last = times[sum(len(s) for s in states) - 1]
            message = f"stopped: the state is not finite after t = {last:.9g} s"
            break
        if progress is not None:
            progress((start + len(grid) - 1) / (len(times) - 1))
    x = np.concatenate(states)
    for place in places:
        x[:, place] /= np.linalg.norm(x[:, place], axis=1, keepdims=True)
    return Motion(times[: len(x)], x, np.empty((len(x), 0)), message)


@lru_cache(maxsize=32)
def _taylor_method(
    flow: Flow, p: tuple[float, ...], tolerance: float | None, real: type[Any]
) -> Any:
    """Heyoka's integrator of the flow, at no state in particular: made once, or from the disk cache."""
    import heyoka as hy

    from deltac.kernels import compiled, prepare_heyoka, to_heyoka

    function = ca.Function("xdot", [flow.t, flow.x, flow.p], [ca.cse(ca.densify(flow.xdot))])
    source = (prepare_heyoka(), real.__name__, tolerance, p, function.serialize())

    def made() -> Any:
        names = [hy.expression(f"x{k}") for k in range(flow.x.shape[0])]
        constants = [hy.expression(value) for value in p]
        (rates,) = to_heyoka(function, [[hy.time], names, constants])
        options: dict[str, Any] = {"tol": real(tolerance)} if tolerance is not None else {}
        nowhere = np.zeros(len(names)).astype(real)
        return hy.taylor_adaptive(
            list(zip(names, rates)), nowhere, fp_type=real, compact_mode=True, **options
        )

    return compiled(repr(source), made)


def _first_step(method: Any, x0: Array, times: Array, real: Any) -> float:
    """A safe length of the first step, from all Taylor coefficients at the start.

    The method goes by the last two orders only, and at a start from rest these may vanish by symmetry.
    """
    method.step(max_delta_t=real(0.0), write_tc=True)
    coefficients = np.abs(np.asarray(method.tc).astype(np.float64))
    method.state[:] = x0.astype(real)
    method.time = real(times[0])
    size = max(1.0, float(np.abs(x0).max()))
    orders = np.arange(1, coefficients.shape[1])
    largest = coefficients[:, 1:].max(axis=0)
    with np.errstate(divide="ignore"):
        radius = float(np.min((size / largest) ** (1.0 / orders)))
    return min(float(times[1] - times[0]), radius / math.e**2)


def _require_smooth(flow: Flow) -> None:
    """InputError if ẋ has a kink anywhere, naming the law where one is to blame."""
    kinked = {getattr(ca, f"OP_{name}") for name in KINKED}
    function = ca.Function("xdot", [flow.t, flow.x, flow.p], [flow.xdot])
    if not any(function.instruction_id(k) in kinked for k in range(function.n_instructions())):
        return
    where = "the equations of motion"
    for element in flow.system.mechanism.elements:
        for value in vars(element).values():
            laws = value if isinstance(value, tuple) else (value,)
            if any(hasattr(law, "free_symbols") and not is_smooth(law) for law in laws):
                where = f"a law of {type(element).__name__} {element.name!r}"
    for joint in flow.system.mechanism.joints:
        if any(hasattr(law, "free_symbols") and not is_smooth(law) for law in joint.motion):
            where = f"the motion of joint {joint.name!r}"
    raise InputError(
        f"the Taylor solver needs smooth equations; {where} may have a kink or jump (abs, sign, min, max, "
        "where, a comparison; the spring of a quaternion). Use 'ode5' or 'DOP853'"
    )
