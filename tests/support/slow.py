"""Repetitions: cases that show again what another case of the same test shows are slow."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

ONE_OF_A_KIND = ("semi-implicit-euler", "ode2", "ode5", "generalized-alpha", "discrete-gradient")
"""Solvers that step, one of every kind; the order of each by itself is in the order suite."""


def repeated(values: Iterable[Any], *fast: Any) -> list[Any]:
    """The parameters of a test: those of `fast` as they are, the others marked slow."""
    values = list(values)
    assert set(fast) <= set(values), f"not among {values}"
    return [v if v in fast else pytest.param(v, marks=pytest.mark.slow) for v in values]
