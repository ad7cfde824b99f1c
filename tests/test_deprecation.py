"""Old names work for one release; each use is told at its own line."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from inspect import currentframe, signature

import pytest

import deltac
from deltac.calls.deprecation import RenamedAttribute, renamed_keywords, warn_renamed
from deltac.errors import InputError


@renamed_keywords(control="controller", h="step")
def run(step, controller=None):
    return step, controller


@renamed_keywords(size="length")
@dataclass(frozen=True)
class Part:
    length: float
    extent = RenamedAttribute("length")


def line():
    return currentframe().f_back.f_lineno


def test_an_old_keyword_reaches_the_new_one_and_is_told_where_it_was_used():
    with pytest.warns(DeprecationWarning) as told:
        assert run(h=0.1, control="c") == (0.1, "c")
        at = line() - 1
    assert sorted(str(w.message) for w in told) == [
        "run(control=…) is now run(controller=…); the old name goes in the next release",
        "run(h=…) is now run(step=…); the old name goes in the next release",
    ]
    assert {(w.filename, w.lineno) for w in told} == {(__file__, at)}


def test_new_names_are_silent_and_the_signature_has_them_alone():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert run(step=0.1, controller=1) == run(0.1, 1)
        assert Part(length=2.0).length == 2.0
    assert list(signature(run).parameters) == ["step", "controller"]


def test_old_and_new_together_are_refused():
    with pytest.raises(InputError, match="step="):
        run(h=0.1, step=0.1)


def test_an_unknown_keyword_is_still_an_error():
    with pytest.raises(InputError, match="controller"):
        run(0.1, speed=2)


def test_a_class_takes_its_old_keywords_and_attributes():
    with pytest.warns(DeprecationWarning, match=r"Part\(size=…\) is now Part\(length=…\)") as told:
        part = Part(size=3.0)
    assert told[0].filename == __file__
    with pytest.warns(DeprecationWarning, match=r"Part\.extent is now Part\.length") as told:
        assert part.extent == 3.0
    assert told[0].filename == __file__


def test_a_warning_is_shown_once_for_each_line():
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        for _ in range(3):
            run(h=0.1)
        run(h=0.1)
    assert len(told) == 2


def test_an_example_is_shown():
    with pytest.warns(DeprecationWarning) as told:
        warn_renamed("f(tolerance=…)", "S(tolerance=…)", write="f(solver=S(tolerance=1e-9))")
    assert "; write f(solver=S(tolerance=1e-9)); " in str(told[0].message)


def test_warnings_of_a_run_blame_the_line_that_called_it():
    with pytest.warns(deltac.SimulationStoppedWarning) as told:
        deltac.simulate("stiff-governor", None, 1.0, 0.1, "ode4")
        at = line() - 1
    assert {(w.filename, w.lineno) for w in told} == {(__file__, at)}


def test_old_arguments_of_simulate_blame_the_line_that_called_it():
    with pytest.warns(DeprecationWarning) as told:
        deltac.simulate("simple-pendulum", None, 0.1, 0.01, testing=("wang",), tolerance=None)
    assert {w.filename for w in told} == {__file__}
