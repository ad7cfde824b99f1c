"""A number of the equations is the same in all stretches of a log; what imitates one is not."""

from __future__ import annotations

import numpy as np
import pytest

from deltac.diagnosis.causes.causes import Candidate
from deltac.diagnosis.inference.hypotheses import Block, Posterior, fitted, steadfast

ROWS, SIZE = 800, 0.05
CAUSE = Candidate("damping", "hinge", (0,), np.eye(1), ("c",), np.zeros(1), ("1",))


def found(size: np.ndarray) -> Posterior:
    """The posterior that has the cause, of rows in which it is so large (K,), beside white noise."""
    rng = np.random.default_rng(5)
    D = rng.standard_normal((ROWS, 1, 1))
    r = D[:, :, 0] * size[:, None] + 0.02 * rng.standard_normal((ROWS, 1))
    none = np.zeros(0, dtype=np.intp)
    block = Block(r, D, none, np.zeros(0), np.array([0]))
    fit = fitted((block,), [CAUSE])
    assert fit is not None
    return steadfast(Posterior(fit, (), ()), (block,), 10)


def test_a_cause_that_all_stretches_tell_stays() -> None:
    best = found(np.full(ROWS, SIZE)).best
    assert best.chosen == (CAUSE,)
    assert best.theta[0][0] == pytest.approx(SIZE, abs=5.0 * 0.02 / np.sqrt(ROWS))


def test_a_cause_that_comes_and_goes_is_none() -> None:
    """The same mean, by turns of both signs: likelihood alone would be sure of it."""
    turns = np.repeat([6.0, -4.0], ROWS // 16)
    assert not found(SIZE * np.resize(turns, ROWS)).best.chosen
