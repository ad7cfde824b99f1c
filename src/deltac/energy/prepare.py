"""A trajectory made ready for interpolation: checked, derived where something is missing."""

from __future__ import annotations

import math
from itertools import pairwise

import casadi as ca
import numpy as np

from deltac.arrays import SAME, Array
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.dynamics.laws import to_casadi
from deltac.dynamics.system import trace
from deltac.energy.sampling.samples import Samples, Smooth, row_blocks, spline_rate
from deltac.energy.sampling.segments import LogRows
from deltac.energy.terms import LoggedForces, columns
from deltac.errors import LogError, closest
from deltac.kernels import Kernel
from deltac.kernels.parallel import spread
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory


def checked_samples(
    mechanism: Mechanism, run: LogRows, log: LoggedForces
) -> tuple[Samples, dict[str, str]]:
    """The free coordinates and speeds with their rates, and the logged forces.

    Where the run has no accelerations they are derived by a spline through the speeds; the second value
    says so. Raises InputError for a run that does not fit the mechanism.
    """
    _check_names(mechanism, run)
    if len(run) < 2:
        ended = run.provenance.message
        raise LogError(
            "the run has a single sample; a balance needs at least two"
            + (f"; the run ended in its first step: {ended}" if ended else "")
        )
    free = mechanism.free
    q, u = columns(run.q, free.q), columns(run.u, free.u)
    basis = {"u̇": "measured"}
    if run.udot is not None:
        measured = columns(run.udot, free.u)
        speeds = Smooth(u, lambda: measured)
    else:
        basis["u̇"] = "derived"
        speeds = Smooth(u, lambda: _rates(run, u))
    steady = _held(run)
    forces = {f"force {name}": values for name, values in log.values(run).items()}
    return Samples(
        t=run.t,
        smooth={
            "q": Smooth(q, lambda: _coordinate_rates(mechanism, run.t, q, u)),
            "u": speeds,
        },
        plain={n: f for n, f in forces.items() if n.removeprefix("force ") not in steady},
        steady={n: f for n, f in forces.items() if n.removeprefix("force ") in steady},
        derived=frozenset({"u"} if run.udot is None else ()),
        inward=run.inward,
    ), basis


def _rates(run: LogRows, y: Array) -> Array:
    """Rates within every smooth piece."""
    pieces = pairwise((0, *run.starts, len(run)))
    return np.concatenate([_rate(run.t[a:b], y[a:b]) for a, b in pieces])


def _rate(t: Array, y: Array) -> Array:
    """`spline_rate` of a piece, in which rows may be at the time of an event; an instant has no rate."""
    later = np.diff(t) > SAME * (t[-1] - t[0])
    if not later.any():
        return np.zeros_like(y)
    if later.all():
        return spline_rate(t, y)
    instants = np.append(True, later)
    return np.asarray(spline_rate(t[instants], y[instants])[np.cumsum(instants) - 1])


def _held(run: LogRows) -> set[str]:
    """Channels that were constant from each sample to the next: held over a step, and every step is here.

    In a log with fewer rows than steps such a force changed in between, as any other.
    """
    step, channels = run.provenance.step, run.provenance.held
    if (
        not channels
        or step is None
        or not math.isclose(float(np.median(np.diff(run.t))), step, rel_tol=0.01)
    ):
        return set()
    return set(channels)


def _check_names(mechanism: Mechanism, run: LogRows) -> None:
    for what, ours, theirs in (
        ("coordinate", mechanism.coordinates.names, run.coordinates),
        ("speed", mechanism.speeds.names, run.speeds),
    ):
        for name in theirs:
            if name not in ours:
                raise LogError(
                    f"the run has a {what} {name!r} that mechanism {mechanism.name!r} does not"
                    f"{closest(name, ours)}"
                )
        missing = [name for name in ours if name not in theirs]
        if missing:
            raise LogError(f"the run lacks the {what}(s) {', '.join(map(repr, missing))}")
        if tuple(theirs) != tuple(ours):
            raise LogError(
                f"the {what}s of the run are in a different order from the mechanism's: {', '.join(theirs)}; "
                f"expected {', '.join(ours)}"
            )


def _coordinate_rates(mechanism: Mechanism, t: Array, q: Array, u: Array) -> Array:
    if not q.shape[1]:
        return q
    kernel = _rates_kernel(mechanism)
    rates = np.empty(q.shape)

    def evaluate(rows: slice) -> None:
        rates[rows] = kernel(t=t[rows], q=q[rows], u=u[rows])["qdot"].reshape(-1, q.shape[1])

    kernel.compile()
    spread(evaluate, row_blocks(len(t)), numbers=q.size)
    return rates


def _rates_kernel(mechanism: Mechanism) -> Kernel:
    """(t, q, u) -> q̇ of the free coordinates."""
    system = trace(mechanism)
    inputs = {"t": system.t, "q": system.q, "u": system.u}
    return system.once("rates", lambda: Kernel(inputs, {"qdot": system.qdot}, name="rates"))


def violations(mechanism: Mechanism, run: Trajectory) -> dict[str, Array]:
    """How far prescribed joints are from their laws, and quaternions from unit length, (T,)."""
    departures: dict[str, Array] = {}
    t = ca.SX.sym("t")
    values = {**{n: ca.SX(v) for n, v in mechanism.parameters.items()}, "t": t}
    for joint in mechanism.joints:
        q_place, u_place = mechanism.coordinates.of(joint.name), mechanism.speeds.of(joint.name)
        if joint.prescribed:
            law = ca.vertcat(*(to_casadi(entry, values) for entry in joint.motion))
            f = ca.Function("law", [t], [law, ca.jacobian(law, t)])
            q, u = (np.array(part).T for part in f.map(len(run))(run.t[None, :]))
            departures[f"coordinate {joint.name}"] = np.abs(run.q[:, q_place] - q).max(axis=1)
            departures[f"speed {joint.name}"] = np.abs(run.u[:, u_place] - u).max(axis=1)
        if joint.name in mechanism.quaternions:
            quaternion = run.q[:, mechanism.quaternions[joint.name]]
            norm = np.einsum("ij,ij->i", quaternion, quaternion)  # norm(axis=1), but fast
            np.sqrt(norm, out=norm)
            norm -= 1.0
            departures[f"quaternion {joint.name}"] = np.abs(norm, out=norm)
    departures.update(_constraint_violations(mechanism, run))
    return departures


def _constraint_violations(mechanism: Mechanism, run: Trajectory) -> dict[str, Array]:
    """Largest |φ| and |ψ| of each constraint, (T,)."""
    if not mechanism.constraints:
        return {}
    motion = equations_of_motion(mechanism)
    system, rows = motion.system, motion.rows
    inputs = {n: c for n, c in (("t", system.t), ("q", system.q), ("u", system.u)) if c.shape[0]}
    outputs = {"phi": rows.phi, "psi": rows.psi}
    kernel = system.once("violation", lambda: Kernel(inputs, outputs, name="violation"))
    free = mechanism.free
    columns = {"t": run.t, "q": run.q[:, free.q], "u": run.u[:, free.u]}
    values = kernel(**{name: columns[name] for name in inputs})
    phi, psi = (np.abs(values[n].reshape(len(run), -1)) for n in ("phi", "psi"))
    departures: dict[str, Array] = {}
    for name in dict.fromkeys(rows.names):
        places = rows.places(name)
        if any(rows.holonomic[k] for k in places):
            departures[f"position {name}"] = phi[:, places].max(axis=1)
        departures[f"velocity {name}"] = psi[:, places].max(axis=1)
    return departures
