"""`correct_trajectory`: a better motion from a log whose integrator is to blame, without another run of it.

Each row y_k of a log has a prediction error w_k = y_{k+1} − φ_k(y_k) by the flow φ_k of the model. If the
equations are right, w is the integrator's, and the error of the log grows along it by the variational
equation, e_{k+1} = Φ_k e_k + w_k. Taking e off and starting again is deferred correction (Pereyra, Numer.
Math. 8 (1966) 376; Dutt, Greengard and Rokhlin, BIT 40 (2000) 241): here a step of Newton's method for the
motion through the first row, so that every sweep squares the error.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from deltac.arrays import EPS, SAME, Array, max_norm
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.linear_algebra import one_thread_per_matrix
from deltac.diagnosis.audit.audit import NORMAL_95, Audit, audit
from deltac.diagnosis.inference.flow import composed, predict, transitions
from deltac.diagnosis.inference.forces import LoggedForce
from deltac.diagnosis.inference.model import Intervals, LogModel, Rows
from deltac.diagnosis.inputs.logs import LogLike
from deltac.diagnosis.measurements.kinematics import SHORTEST_PART
from deltac.dynamics.admissible import onto_positions, onto_speeds
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.energy import balance
from deltac.errors import InputError
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike
from deltac.results import Report, Section, number
from deltac.trajectories import Trajectory
from deltac.trajectories.formats.mapping import MappingLike
from deltac.trajectories.motion import CLEAR_RATIO

FLOW = SAME
"""Error of the flow over an interval, as a share of the sizes of coordinates and speeds."""


@dataclass(frozen=True, eq=False)
class Correction(Report, omit=("run", "audit")):
    """A corrected motion, how far the log was off, and what is left.

    Attributes:
        run: the corrected motion at the rows of the log, up to where it can be followed. Logged forces are
            kept.
        log_error: of the log, at each row (T, 2n): along the n free speeds (m, rad), then of these speeds.
        remaining: estimate of the largest error that is left of each of these (2n,): of the last correction,
            of the flow, and of what the noise of the first row makes of the motion (twice its deviation).
        sweeps: the largest correction of each sweep, in the order of the sweeps.
        delta_c: largest |ΔC| of the corrected motion, J, Wang's function along the rows; `log_delta_c`: of
            the log; `error_bar`: how far both may be off by the interpolation between rows.
        audit: of the log, with its integrator.
    """

    run: Trajectory
    log_error: Array
    remaining: Array
    sweeps: tuple[float, ...]
    delta_c: float
    log_delta_c: float
    error_bar: float
    audit: Audit

    @property
    def exit_code(self) -> int:
        """0: there is a corrected motion."""
        return 0

    def summary(self) -> str:
        """How far the log was off, and the corrected motion may be."""
        error, remainder = max_norm(self.log_error), float(self.remaining.max())
        return (
            f"the log is off by up to {number(error, digits=2)}, the corrected motion by about "
            f"{number(remainder, digits=1)}; |ΔC| {number(self.log_delta_c, 'J', 2)} → "
            f"{number(self.delta_c, 'J', 2)}"
        )

    def sections(self) -> Iterator[Section]:
        """The summary, and how it was found."""
        yield f"{self.summary()[0].upper()}{self.summary()[1:]} (m, rad and their rates)."
        sizes = ", ".join(number(size, digits=2) for size in self.sweeps)
        yield f"Corrections of successive sweeps: {sizes}; up to t = {self.run.t[-1]:.6g} s."


@checked
@interruptible()
@one_thread_per_matrix()
def correct_trajectory(
    model: ModelLike,
    log: LogLike,
    *,
    mapping: MappingLike = None,
    coordinates: CoordinateMap | str | None = None,
) -> Correction:
    """Correct the integration error of a log by the model's equations.

    The first row is taken as right, and so are the model's equations and the logged forces.

    Args:
        model: as for `audit`.
        log: as for `audit`.
        mapping: path of a mapping file, for logs whose columns have other names or units.
        coordinates: those of the log's columns, as for `audit`.

    Raises:
        InputError: as `audit`; a log that contradicts the equations, which a correction would replace by the
            model's motion; impacts; a motion that cannot be followed from its first row on, as where it is
            chaotic; noise or digits that hide the error of the integrator.
    """
    result = audit(model, log, mapping=mapping, coordinates=coordinates)
    mechanism, run = result.mechanism, result.run
    if result.verdict.kind == "equation-error":
        raise _refused(
            f"the log contradicts the equations of the model: {result.verdict.evidence[0]}"
        )
    if run.events:
        raise _refused("the log has impacts or switches, across which no error can be followed")
    run = replace(run, forces=_outer_forces(mechanism, run))
    model_of_rows = LogModel(mechanism, run)
    rows = model_of_rows.rows(run)
    smooth = ("smooth",) * rows.F.shape[1]
    forces = smooth if result.inference is None else result.inference.forces
    scale = _sizes(rows)
    total, sizes = np.zeros((len(run), 2 * model_of_rows.n)), list[float]()
    # The digits and the noise of the first row: the motion through it is off by what becomes of them.
    noise = np.zeros(2 * model_of_rows.n)
    if result.inference is not None:
        noise = result.inference.log.noise[0][0]
    before: Array | None = (
        None  # the largest correction of the last sweep up to each row, shares of the scale
    )
    while before is None or before[-1] > FLOW:
        error, doubt = _error(model_of_rows, rows, forces, noise)
        now = np.maximum.accumulate(
            np.max(np.abs(np.nan_to_num(error, nan=np.inf)) / scale, axis=1)
        )
        finite = np.full(len(now), np.finfo(float).max)
        lost = now > (finite if before is None else np.maximum(CLEAR_RATIO * before, FLOW))
        count = int(np.argmax(lost)) if lost.any() else len(now)
        if count < SHORTEST_PART:
            raise _refused(
                f"from t = {rows.t[count]:.4g} s on corrections do not become smaller: the motion is "
                "chaotic, or the steps are far too long"
            )
        rows, error, total = rows.take(slice(count)), error[:count], total[:count] + error[:count]
        rows = _moved(model_of_rows, rows, -error)
        sizes.append(max_norm(error))
        ratio = 1.0 if before is None else float(now[count - 1] / max(before[count - 1], EPS))
        before = now[:count]
    # What is left is to the last correction as that is to the one before; and what is not known.
    remaining = np.abs(error).max(axis=0) * min(ratio, 1.0) + NORMAL_95 * doubt[:count].max(axis=0)
    if CLEAR_RATIO * np.max(np.abs(total) / scale) < np.max(remaining / scale):
        raise _refused(
            f"the log is off by up to {np.abs(total).max():.2g} from the motion through its first row, which "
            f"is known to {remaining.max():.2g} only, for the noise and digits of that row: the error of the "
            "integrator is not seen"
        )
    corrected = _trajectory(mechanism, run, rows)
    part = _trajectory(mechanism, run, model_of_rows.rows(run).take(slice(len(rows.t))))
    ledger, log_ledger = (balance(mechanism, r, "samples", ("wang",)) for r in (corrected, part))
    return Correction(
        corrected,
        total,
        remaining,
        tuple(sizes),
        max_norm(ledger.delta_c["wang"]),
        max_norm(log_ledger.delta_c["wang"]),
        float(ledger.error_bar["wang"].max()),
        result,
    )


def _outer_forces(mechanism: Mechanism, run: Trajectory) -> dict[ChannelName, Array]:
    """Logged forces that the motion does not determine: those of laws, and of constraints, are the model's.

    The log's own are those of a motion that is off. Corrections of the simulator are part of its error.
    """
    parts = (*mechanism.joints, *mechanism.forces)
    laws = {f"{kind} {part.name}" for part in parts for kind in part.channel_kinds}
    determined = ("correction", "constraint", "prescribed")
    return {
        name: force
        for name, force in run.forces.items()
        if name.kind not in determined and str(name) not in laws
    }


def _error(
    model: LogModel, rows: Rows, forces: tuple[str, ...], noise: Array
) -> tuple[Array, Array]:
    """The error (T, 2n) of rows against the motion through the first of them, to first order; its deviation.

    The `noise` (2n,) of the first row moves the whole motion, and so does the flow's own error, which may be
    the same in every interval.
    """
    last = len(rows.t) - 1
    intervals = Intervals(rows.take(slice(last)), rows.take(slice(1, last + 1)))
    force = LoggedForce.of(intervals, [(0, last)])(forces)
    accepted = np.broadcast_to(FLOW * _sizes(rows), (last, 2 * model.n))
    with np.errstate(all="ignore"):
        flow = predict(model, intervals, force, accepted)
        defect = model.difference(flow.end, intervals.end)
        nodes = [flow.nodes[k] for k in (0, len(flow.nodes) // 2, -1)]
        Phi = composed(transitions(intervals.h, [model.jacobian(node) for node in nodes]))
        error = np.zeros((last + 1, 2 * model.n))
        doubt = np.zeros_like(error)
        doubt[0], covariance = noise, np.diag(noise**2)
        for k in range(last):
            error[k + 1] = Phi[k] @ error[k] + defect[k]
            covariance = Phi[k] @ covariance @ Phi[k].T + np.diag(last * flow.error[k] ** 2)
            doubt[k + 1] = np.sqrt(np.diag(covariance))
    return error, doubt


def _sizes(rows: Rows) -> Array:
    """Sizes (2n,) of what moves along the speeds, and of these."""
    n = rows.u.shape[1]
    return np.concatenate(
        [np.full(n, 1.0 + np.abs(rows.q).max()), np.full(n, np.abs(rows.u).max())]
    )


def _moved(model: LogModel, rows: Rows, by: Array) -> Rows:
    """Rows displaced by (T, 2n), back on the constraints."""
    q = model.moved(rows.q, by[:, : model.n], np.ones((len(by), 1)))
    u = rows.u + by[:, model.n :]
    if model.mechanism.constraints:
        motion = equations_of_motion(model.mechanism)
        onto = onto_positions(motion, rows.t, q.T.copy())
        q, u = onto.T, onto_speeds(motion, rows.t, onto, u.T.copy()).T
    return Rows(rows.t, q, u, rows.F)


def _trajectory(mechanism: Mechanism, run: Trajectory, rows: Rows) -> Trajectory:
    """The log with these free coordinates and speeds, and its logged forces."""
    count = len(rows.t)
    q, u = np.array(run.q[:count]), np.array(run.u[:count])
    q[:, mechanism.free.q], u[:, mechanism.free.u] = rows.q, rows.u
    forces = {name: force[:count] for name, force in run.forces.items()}
    notes = {**run.provenance.notes, "corrected": "deferred correction"}
    provenance = replace(run.provenance, notes=notes)
    return replace(
        run,
        t=rows.t,
        q=q,
        u=u,
        udot=None,
        forces=forces,
        works={},
        integrals={},
        provenance=provenance,
    )


def _refused(why: str) -> InputError:
    return InputError(
        f"correct_trajectory: {why}. Simulate again with shorter steps, or another solver"
    )
