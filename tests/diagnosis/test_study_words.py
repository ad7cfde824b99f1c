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
    return dc.study(problem, duration=1.0, steps=steps, **{"solver": "ode4", **options})


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


@pytest.mark.filterwarnings("error")
def test_a_line_is_drawn_through_the_points_it_was_fitted_to() -> None:
    """Stick-slip: the order is of the first 0.1 s; the largest |ΔC| of the whole runs grows."""
    from deltac.report import study_figure

    found = dc.study("stick-slip", steps=(1e-2, 5e-3, 2.5e-3), solver="ode4")
    energy = found.observed_order["wang"]
    panel = study_figure("stick-slip", found).axes[0]
    (line,) = [x for x in panel.get_lines() if str(x.get_label()).startswith("order")]
    h, y = line.get_data()
    for step, size in list(zip(found.measures.steps, energy.sizes))[-2:]:
        assert np.interp(step, np.sort(h), np.sort(y)) == pytest.approx(size, rel=0.04)
    legend = panel.get_legend()
    assert legend is not None
    figure = panel.figure
    figure.canvas.draw()  # type: ignore[union-attr]
    assert not legend.get_window_extent().overlaps(panel.get_window_extent())


# --- warnings -------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
def test_warnings_of_the_steps_become_one_finding() -> None:
    found = dc.study("stick-slip", duration=0.5, steps=(1e-2, 5e-3, 2.5e-3), solver="ode4")
    (stiff,) = [f for f in found.findings if f.kind == "stiff-step"]
    assert "0.01, 0.005, 0.0025 s are too large" in stiff.what and "rub" in stiff.evidence


def test_other_warnings_of_a_simulator_go_on() -> None:
    import warnings

    problem = dc.problems.load("simple-pendulum")

    def warning(step: float) -> dc.Trajectory:
        warnings.warn("battery low", UserWarning, stacklevel=1)
        return dc.simulate(problem.mechanism, problem.state, 1.0, step, "ode4")

    with pytest.warns(UserWarning, match="battery low"):
        dc.study(problem, simulator=warning, steps=(2e-2, 1e-2, 5e-3))
