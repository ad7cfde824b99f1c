"""What tests of several recorders ask of the works that they take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import deltac as dc

ROUNDING = 1e-12  # of the energies, for a bar in which nothing but rounding is left


def takes_the_works_of_held_forces(mechanism: dc.Mechanism, runs: Sequence[dc.Trajectory]) -> None:
    """Each run's works are the discrete ones of its rows, and ΔC has the bar of rounding.

    The discrete works are computed by `balance` from the forces and speeds of the rows.
    """
    for run in runs:
        p = run.provenance
        assert (p.order, p.inputs) == (1, "held")
        assert p.held is not None and set(p.held) == set(run.forces)
        taken, discrete = (dc.balance(mechanism, run, work) for work in (None, "discrete"))
        assert taken.method == "in-loop"
        assert taken.error_bar["wang"].max() < ROUNDING * (
            taken.energy_exchanged + np.abs(taken.potential_energy).max() + taken.kinetic.max()
        )
        scale = ROUNDING * max(taken.energy_exchanged, 1e-3)
        assert np.allclose(taken.delta_c["wang"], discrete.delta_c["wang"], atol=scale)
        for name in run.forces:
            assert np.allclose(taken.work[name], discrete.work[name], atol=scale), name
