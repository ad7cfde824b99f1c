"""What the digits of a log and the noise on it make of ΔC: an error bar beside that of the quadrature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.inputs.logs import Log
from deltac.diagnosis.measurements.digits import Digits, digits_of, least_of_forces
from deltac.diagnosis.residuals.one_step import OneStep
from deltac.energy import balance
from deltac.mechanism.mechanism import Mechanism

DRAWS = 3
"""How often the log is moved at random."""

MOST_ROWS = 4000
"""Rows of a long log that are: the noise of its first and of its last rows is what counts."""

COARSE = 1e-9
"""Share of a column's size from which on its digits and noise are looked at."""


def energy_of_noise(
    mechanism: Mechanism, log: Log, work: str | None, function: str, step: OneStep | None
) -> float:
    """Error bar (J) of the largest |ΔC| that comes of digits and noise of q, u and the forces.

    ΔC is taken of the log and of the log with every number moved at random by as much as it is uncertain. Of
    noise nothing is known without the one-step test.
    """
    run = log.consecutive
    if run.integrals or len(run) < 16:
        return 0.0
    if len(run) > MOST_ROWS:
        run = run.between(run.t[0], run.t[MOST_ROWS - 1])
    # What looks like noise may be kinks of forces, or a motion that the rows hardly resolve.
    real = step.residual.noisy if step is not None and not step.closes else 0.0
    columns = {"q": run.q, "u": run.u, **run.forces}
    of_run = digits_of(run)
    least = least_of_forces(of_run)
    known = {n: of_run[n] if n in of_run else Digits(x, least) for n, x in columns.items()}
    sizes = {
        n: (digits.half(), real * digits.noise if real else np.zeros(columns[n].shape[1]))
        for n, digits in known.items()
    }
    coarse = [
        np.any(
            np.sqrt(np.mean(d**2, axis=0)) + w > COARSE * np.sqrt(np.mean(columns[n] ** 2, axis=0))
        )
        for n, (d, w) in sizes.items()
    ]
    if not any(coarse):
        return 0.0
    rng = np.random.default_rng(11)

    def moved(name: str, x: Array) -> Array:
        digits, deviation = sizes[name]
        return np.asarray(
            x + digits * rng.uniform(-1.0, 1.0, x.shape) + deviation * rng.standard_normal(x.shape)
        )

    told = balance(mechanism, run, work).delta_c[function]
    most = 0.0
    for _ in range(DRAWS):
        forces = {n: moved(n, f) for n, f in run.forces.items()}
        other = replace(run, q=moved("q", run.q), u=moved("u", run.u), forces=forces)
        change = balance(mechanism, other, work).delta_c[function] - told
        most = max(most, float(np.abs(change - np.mean(change)).max()))
    return 2.0 * most  # the first row, from which ΔC is counted, errs as much as any other
