"""Repetitions: cases that show again what another case of the same test shows are slow."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import pytest

ONE_OF_A_KIND = ("semi-implicit-euler", "ode2", "ode5", "generalized-alpha", "discrete-gradient")
"""Solvers that step, one of every kind; the order of each by itself is in the order suite."""


def repeated(values: Iterable[Any], *fast: Any) -> list[Any]:
    """The parameters of a test: those of `fast` as they are, the others marked slow."""
    values = list(values)
    assert all(one in values for one in fast), f"not among {values}"
    return [v if v in fast else pytest.param(v, marks=pytest.mark.slow) for v in values]


def crossed(*factors: Iterable[Any]) -> list[Any]:
    """All combinations of some factors: fast are as many as have every value of each factor once."""
    values = [list(factor) for factor in factors]
    fast = {tuple(k % len(v) for v in values) for k in range(max(map(len, values)))}
    places = itertools.product(*(range(len(v)) for v in values))
    return [
        pytest.param(
            *(v[k] for v, k in zip(values, place)), marks=() if place in fast else pytest.mark.slow
        )
        for place in places
    ]
