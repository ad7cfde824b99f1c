"""From a trajectory to a ledger: where the energy went. Knows nothing of how a run was made."""

from __future__ import annotations

from deltac.dynamics.testing_functions import TESTING_FUNCTIONS
from deltac.energy.accumulator import balance
from deltac.energy.balance import residuals
from deltac.energy.ledger import Ledger
from deltac.energy.live import (
    CARRIED,
    MOMENTA,
    QUADRATURE,
    RESULTS,
    SETTINGS,
    Given,
    LiveKernels,
    Memory,
    live_kernels,
)

__all__ = [
    "CARRIED",
    "MOMENTA",
    "QUADRATURE",
    "RESULTS",
    "SETTINGS",
    "TESTING_FUNCTIONS",
    "Given",
    "Ledger",
    "LiveKernels",
    "Memory",
    "balance",
    "live_kernels",
    "residuals",
]
