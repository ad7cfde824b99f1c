"""Where a motion departs from its model: which equation and joint, when, and by which term."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from deltac.arrays import SOLVED, Array
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.diagnosis.check.location import Blame, blame
from deltac.diagnosis.residuals.at_samples import (
    MOST_SAMPLES,
    RunResidual,
    run_residual,
)
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.residuals.states import some_rows
from deltac.energy import Ledger, balance
from deltac.mechanism.coordinate_map import CoordinateMap, own_coordinates
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike, load_model
from deltac.results import Report
from deltac.trajectories import Trajectory

BULK = 0.8
"""Share of the residual that lies within the reported interval."""


@dataclass(frozen=True, eq=False, repr=False)
class Localisation(Report, omit=("t", "residual", "joints"), also=("power",)):
    """Where a motion departs from its model, at T samples.

    Attributes:
        t: times (T,), s.
        speeds: names of the (own) speeds; `residual`: F_r + F*_r of each (T, n), N or N·m; without
            accelerations what changes ΔP_r between the rows.
        joints: power that each joint takes beyond what the model's forces supply (T,), W: −Σ u_r (F_r + F*_r)
            over its speeds. Zero where the motion obeys the model.
        departures: the equations that do not hold, the worst first.
    """

    t: Array
    speeds: tuple[str, ...]
    residual: Array
    joints: Mapping[str, Array]
    departures: tuple[Blame, ...]

    @property
    def exit_code(self) -> int:
        """Exit code: 0 the motion obeys the model, 1 it does not."""
        return 1 if self.departures else 0

    @property
    def power(self) -> dict[str, float]:
        """Largest power that each joint takes beyond what the model supplies, W."""
        return {name: float(np.abs(values).max()) for name, values in self.joints.items()}

    def summary(self) -> str:
        """How many equations do not hold, and which is the worst."""
        if not self.departures:
            return "the motion obeys the model's equations at all samples"
        return f"{len(self.departures)} equations do not hold; {self.departures[0]}"

    def sections(self) -> Iterator[str]:
        """The equations that do not hold, and the power that the model does not supply."""
        if not self.departures:
            yield "The motion obeys the model's equations at all samples."
            return
        for k, departure in enumerate(self.departures):
            yield f"{'Where' if k == 0 else 'Also'}: {departure}."
        power = self.power
        total = max(power.values(), default=0.0)
        shown = [n for n in sorted(power, key=lambda n: -power[n]) if power[n] > 1e-3 * total > 0.0]
        if shown:
            powers = ", ".join(f"{name} {power[name]:.3g} W" for name in shown)
            yield f"Power that the model does not supply, at most: {powers}."


@checked
@interruptible()
def localise(
    model: ModelLike, run: Trajectory, *, coordinates: CoordinateMap | str | None = None
) -> Localisation:
    """Find where a motion departs from a model: in which equation and joint, when, and by which term.

    With accelerations nothing is integrated. A run without any is told by the momentum functions ΔP_r, which
    name the equation and not the term, and see the integrator's error too. Forces that the run holds take the
    place of the model's.

    Args:
        model: a Mechanism, a Problem, or what else `load_model` takes.
        run: the motion, at least two samples.
        coordinates: own coordinates and speeds, in which the equations are told: a CoordinateMap, whose
            inverse must be known, or "absolute". By default the mechanism's own.

    Raises:
        InputError: a run that is not the mechanism's, or a map without inverse.
    """
    mechanism = load_model(model).mechanism
    if isinstance(run, Trajectory) and run.udot is None:
        return _by_momenta(mechanism, run, own_coordinates(mechanism, coordinates))
    samples = run_residual(Kane(mechanism, coordinates), run)
    own = samples if coordinates is None else run_residual(Kane(mechanism), run)
    joints: dict[str, Array] = {}
    for index, power in zip(mechanism.free.u, -own.test.states.u * own.residual):
        joint = mechanism.speeds[int(index)].joint
        joints[joint] = joints.get(joint, 0.0) + power
    t, departures = samples.test.states.t, _departures(samples)
    return Localisation(t, samples.test.speeds, samples.residual.T, joints, departures)


def _by_momenta(
    mechanism: Mechanism, run: Trajectory, coordinates: CoordinateMap | None
) -> Localisation:
    """The same without accelerations, by what changes ΔP_r."""
    rows = some_rows(run, MOST_SAMPLES)
    t = run.t[rows]

    def forces(ledger: Ledger) -> dict[str, Array]:
        return {n: -np.gradient(delta[rows], t) for n, delta in ledger.delta_p.items()}

    ledger = own = balance(mechanism, run, "samples", ("momentum",))
    if coordinates is not None:
        own = balance(mechanism, run, "samples", ("momentum",), coordinates=coordinates)
    joints: dict[str, Array] = {}
    for index, force in zip(mechanism.free.u, forces(ledger).values()):
        joint = mechanism.speeds[int(index)].joint
        joints[joint] = joints.get(joint, 0.0) - run.u[rows, int(index)] * force
    residual, departures = forces(own), []
    for k, (name, size) in enumerate(own.momenta().items()):
        if size["delta_p"] > size["error_bar"] and size["relative"] > SOLVED:
            span = _span(t, residual[name])
            entry = Blame(name, k + 1, size["relative"], span=span, scale="the momentum exchanged")
            departures.append(entry)
    departures.sort(key=lambda departure: -departure.relative)
    names, columns = tuple(residual), np.array([*residual.values()]).T
    return Localisation(t, names, columns, joints, tuple(departures))


def _departures(samples: RunResidual) -> tuple[Blame, ...]:
    """The equations that neither digits nor rounding explain."""
    limit = np.where(samples.relative > 0.0, 0.0, np.inf)
    return tuple(
        replace(
            entry,
            span=_span(samples.test.states.t, samples.residual[entry.number - 1]),
            scale="its terms",
        )
        for entry in blame(samples.test, samples.udot, limit)
    )


def _span(t: Array, values: Array) -> tuple[float, float]:
    """The shortest interval that holds most of the squares of values (T,)."""
    total = np.concatenate([[0.0], np.cumsum(values**2)])
    ends = np.searchsorted(total, total[:-1] + BULK * total[-1])
    lengths = np.where(ends < len(total), ends - np.arange(len(values)), len(values) + 1)
    first = int(np.argmin(lengths))
    last = min(int(ends[first]), len(values)) - 1
    return float(t[first]), float(t[last])
