"""Problems compared with their references: a wrong number is seen, a right one passes."""

from __future__ import annotations

import dataclasses

import pytest

from deltac import problems
from deltac.references import compare


def test_right_references_are_met() -> None:
    compared = compare(problems.load("simple-pendulum"))
    assert compared and all(row.agrees for row in compared)


def test_a_wrong_reference_is_seen() -> None:
    problem = problems.load("simple-pendulum")
    first = problem.reference[0]
    wrong = dataclasses.replace(first, value=first.value * (1 + 1e-9))
    (row,) = compare(dataclasses.replace(problem, reference=(wrong,)))
    assert not row.agrees
    assert row.value == pytest.approx(first.value, rel=1e-12)


def test_a_coarse_run_is_given_its_own_error() -> None:
    problem = problems.load("simple-pendulum")
    coarse = dataclasses.replace(problem, step=0.1, solver="ode4")
    compared = compare(coarse)
    assert max(row.error for row in compared) > 1e-6
    assert all(row.agrees for row in compared)
