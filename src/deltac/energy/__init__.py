"""From a trajectory to a ledger: where the energy went. Knows nothing of how a run was made."""

from __future__ import annotations

from deltac.dynamics.testing_functions import TESTING_FUNCTIONS
from deltac.energy.accumulator import balance
from deltac.energy.balance import residuals
from deltac.energy.ledger import Ledger

__all__ = ["TESTING_FUNCTIONS", "Ledger", "balance", "residuals"]
