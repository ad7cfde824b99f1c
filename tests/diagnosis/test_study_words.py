"""What `study` says: errors, confidence and reasons must be true of the numbers beside them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import Study
from deltac.errors import InputError


def pendulum(steps: tuple[float, ...] = (2e-2, 1e-2, 5e-3), **options: Any) -> Study:
    problem = dc.problems.load("simple-pendulum")
    return dc.study(problem, steps=steps, **{"duration": 1.0, "solver": "ode4", **options})


# --- equations by hand ----------------------------------------------------------------------------


def raising(t: float, q: Any, u: Any) -> Any:
    raise ZeroDivisionError("no luck")


def raising_later(t: float, q: Any, u: Any) -> Any:
    if t > 0.5:
        raise ValueError("too late")
    return -9.81 * np.sin(q)


@pytest.mark.parametrize(
    ("rhs", "said"),
    [
        (raising, "raised ZeroDivisionError: no luck .*State: t = 0, q.pivot = -1.57"),
        (raising_later, "raised ValueError: too late .*State: t = 0.50"),
        (lambda t, q, u: q * np.nan, "not finite at the start.*nan.*State: t = 0, q.pivot"),
        (lambda t, q, u: None, "returned nothing"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_function_that_fails_is_named_with_its_state(rhs: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        pendulum(equations=rhs)


# --- orders ---------------------------------------------------------------------------------------


def test_the_order_of_delta_c_is_that_of_its_maxima() -> None:
    """ode4 on the triple pendulum: by hand, the maxima of the table fall at 3.9; users expect p … p + 1."""
    found = dc.study("triple-pendulum", duration=2.0, steps=(4e-3, 2e-3, 1e-3, 5e-4), solver="ode4")
    wang = found.observed_order["wang"]
    sizes = np.array(wang.sizes)
    by_hand = np.log2(sizes[:-1] / sizes[1:])
    assert wang.order == pytest.approx(by_hand[-1], abs=0.06)  # neighbours within 0.1 are averaged
    assert wang.order == pytest.approx(4.0, abs=0.15)
    assert wang.order_error is not None and wang.order_error < 1.0
    labels = found.plot().axes[0].get_legend_handles_labels()[1]
    assert "the same, at times that all steps share" in labels  # these motions do not part


@pytest.mark.filterwarnings("error")
def test_a_line_is_drawn_through_the_points_it_was_fitted_to() -> None:
    """Stick-slip: the order is of the first 0.1 s; the largest |ΔC| of the whole runs grows."""
    found = dc.study("stick-slip", steps=(1e-2, 5e-3, 2.5e-3), solver="ode4")
    energy = found.observed_order["wang"]
    panel = found.plot().axes[0]
    (line,) = [x for x in panel.get_lines() if str(x.get_label()).startswith("order")]
    h, y = line.get_data()
    for step, size in list(zip(found.steps, energy.sizes))[-2:]:
        drawn = np.exp(np.interp(np.log(step), np.log(np.sort(h)), np.log(np.sort(y))))
        assert drawn == pytest.approx(size / found.energy_exchanged, rel=0.04)
    legend = panel.get_legend()
    assert legend is not None
    figure = panel.figure
    figure.canvas.draw()
    assert not legend.get_window_extent().overlaps(panel.get_window_extent())


# --- warnings -------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
def test_warnings_of_the_steps_become_one_finding() -> None:
    found = dc.study("stick-slip", duration=0.5, steps=(1e-2, 5e-3, 2.5e-3), solver="ode4")
    (stiff,) = [f for f in found.findings if f.kind == "stiff-step"]
    assert all(f"the step {h} s is too large" in stiff.what for h in ("0.01", "0.005", "0.0025"))
    assert "rub" in stiff.evidence


def test_other_warnings_of_a_simulator_go_on() -> None:
    import warnings

    problem = dc.problems.load("simple-pendulum")

    def warning(step: float) -> dc.Trajectory:
        warnings.warn("battery low", UserWarning, stacklevel=1)
        return dc.simulate(problem.mechanism, problem.state, 1.0, step, "ode4")

    with pytest.warns(UserWarning, match="battery low"):
        dc.study(problem, runs=warning, steps=(2e-2, 1e-2, 5e-3))


# --- values, confidence, few steps ----------------------------------------------------------------


@pytest.mark.filterwarnings("error")
def test_a_value_is_told_of_the_time_that_its_order_is_of() -> None:
    """Stick-slip at coarse steps: |ΔC| falls for 0.1 s only, and over the whole runs it grows."""
    found = dc.study("stick-slip", steps=(1e-2, 5e-3, 2.5e-3), solver="ode4")
    assert found.errors[-1] > 5.0 * found.errors[1]  # it grows
    assert found.verdict.confidence == "medium"
    meaning = found.verdict.meaning
    within = np.abs(found.runs[-1].energy_error["wang"][found.runs[-1].run.t <= found.horizon])  # type: ignore[index,union-attr]
    assert f"up to t = {found.horizon:.4g} s, where the runs diverge" in meaning
    assert f"it is {within.max():.2g} J by then" in meaning
    assert f"{found.errors[-1]:.2g} J of" in meaning and "whole run" in meaning
    assert "do not resolve the motion" in meaning


@pytest.mark.parametrize("steps", [(0.02, 0.02, 0.02), (0.02, 0.0199, 0.0198)])
def test_steps_that_do_not_refine_each_other_are_refused(steps: tuple[float, ...]) -> None:
    with pytest.raises(dc.InputError, match="half of the previous one"):
        pendulum(steps, solver="ode1")


def test_one_step_gives_no_order_and_no_false_reason() -> None:
    found = pendulum((0.01,), solver="ode1")
    assert (found.verdict.kind, found.verdict.confidence) == ("integration-error", "medium")
    assert "One step gives no order" in found.verdict.meaning
    assert "nothing converges" not in found.verdict.explain()


def test_steps_that_do_not_divide_leave_one_and_that_is_said() -> None:
    found = pendulum((0.03, 0.02, 0.013))
    assert found.steps == (0.02,)
    assert found.verdict.confidence == "medium"
    assert "One step gives no order" in found.verdict.limits[-1]
    assert "does not divide the duration" in found.verdict.explain()


def test_two_steps_are_no_high_confidence() -> None:
    found = pendulum((0.02, 0.01), solver="ode1")
    assert (found.verdict.kind, found.verdict.confidence) == ("integration-error", "medium")
    assert "Two steps cannot confirm an order" in found.verdict.limits[-1]
    assert str(found.observed_order["state"]) == "two runs"
    assert pendulum(solver="ode1").verdict.confidence == "high"  # three


@pytest.mark.parametrize("empty", [{"steps": ()}, {"steps": None, "solver": ()}])
def test_no_steps_at_all_are_refused(empty: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="was given; give three") as refused:
        pendulum(**empty)
    assert refused.value.code == "E-VALUE"


# --- blow-ups, solver noise -----------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
def test_a_blow_up_is_no_damaged_file_and_has_no_order() -> None:
    """ode4 follows the governor's fastest decay, 0.123 ms, below h = 0.34 ms: coarser ones blow up."""
    with pytest.raises(
        InputError, match=r"blows up at once.*smaller steps, or an implicit"
    ) as refused:
        dc.study("stiff-governor", duration=1.0, steps=(0.1, 0.05, 0.025), solver="ode4")
    assert "damaged" not in str(refused.value)
    found = dc.study("stiff-governor", duration=1.0, steps=(2e-3, 1e-3, 5e-4), solver="ode4")
    assert found.verdict.kind == "integration-error" and "blows up" in found.verdict.meaning
    assert all(c.order is None for c in found.observed_order.values())
    assert "damaged" not in found.verdict.explain()
    assert len([f for f in found.findings if f.kind == "stopped"]) == 1


def test_accelerations_beyond_bounds_are_a_blow_up_too() -> None:
    problem = dc.problems.load("simple-pendulum")

    def exploding(step: float) -> dc.Trajectory:
        run = dc.simulate(problem.mechanism, problem.state, 1.0, step, "ode4")
        assert run.udot is not None
        udot = run.udot.copy()
        udot[-1] *= 1e60 if step == 1e-2 else 1.0
        return dc.Trajectory(
            t=run.t, q=run.q, u=run.u, udot=udot, coordinates=run.coordinates, speeds=run.speeds
        )

    found = dc.study(problem, runs=exploding, steps=(2e-2, 1e-2, 5e-3))
    assert "the run blows up: accelerations reach" in found.runs[1].failure
    assert "damaged" not in found.verdict.explain()


@pytest.mark.parametrize(
    ("solver", "kept"), [("implicit-midpoint", "liu-huston"), ("discrete-gradient", "wang")]
)
def test_energy_that_is_kept_by_construction_is_at_its_floor(solver: str, kept: str) -> None:
    """What iteration leaves of it grows with the number of steps: that is no order."""
    found = pendulum((0.04, 0.02, 0.01), duration=2.0, solver=solver)
    energy = found.observed_order[kept]
    assert energy.order is None and str(energy) == "at its floor"
    named = [x for x in found.verdict.limits if "conserves energy by construction" in x]
    assert bool(named) == (kept == found.function)
