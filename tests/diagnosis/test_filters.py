"""States behind a filter are judged by what went into it; limits that a log reaches accuse nobody."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, filtfilt, lfilter

import deltac as dc
from deltac.diagnosis.audit.habits import LowPass
from deltac.diagnosis.inputs.omissions import limits_reached
from deltac.importers.report import ImportReport, Remark
from tests.systems.cart_pole import CartPole, log

pytestmark = pytest.mark.case_study(
    "test_a_filter_of_all_states_is_told_with_its_delay",
    "test_limits_that_rows_reach",
    "test_the_log_itself_went_through_none",
)

SYSTEM = CartPole(drive=0.0)
STEP, LATE = 0.002, 20
MASS, LENGTH, INERTIA, DAMPING, GRAVITY = 0.9, 0.35, 0.02, 0.06, 9.81


def pendulum() -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[
            dc.body("bar", MASS, inertia=(INERTIA, INERTIA, INERTIA), mass_centre=(0, -LENGTH, 0))
        ],
        joints=[dc.revolute("pin", "ground", "bar", "z", damping=DAMPING)],
        gravity=(0, -GRAVITY, 0),
    )


def swung() -> dc.Trajectory:
    """By the classical Runge–Kutta method, from equations by hand."""

    def rate(y: np.ndarray) -> np.ndarray:
        torque = -MASS * GRAVITY * LENGTH * np.sin(y[0]) - DAMPING * y[1]
        return np.array([y[1], torque / (INERTIA + MASS * LENGTH**2)])

    rows, h = [np.array([2.2, 0.0])], STEP
    for _ in range(1500):
        y = rows[-1]
        k1 = rate(y)
        k2 = rate(y + 0.5 * h * k1)
        k3 = rate(y + 0.5 * h * k2)
        k4 = rate(y + h * k3)
        rows.append(y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
    y = np.array(rows)
    return dc.Trajectory(
        t=h * np.arange(len(y), dtype=float), q=y[:, :1], u=y[:, 1:], coordinates=("pin",), speeds=("pin",),
        provenance=dc.Provenance("by hand"),
    )  # fmt: skip


def smoothed(run: dc.Trajectory) -> dc.Trajectory:
    """Behind y_k = a y_{k−1} + (1 − a) x_k, which is late by h a/(1 − a)."""
    a = np.exp(-1.0 / LATE)

    def through(x: np.ndarray) -> np.ndarray:
        return np.asarray(lfilter([1.0 - a], [1.0, -a], x - x[0], axis=0) + x[0])

    return replace(run, q=through(run.q), u=through(run.u))


def test_a_filter_of_all_states_is_told_with_its_delay() -> None:
    audit = dc.audit(pendulum(), smoothed(swung()))
    assert audit.verdict.kind == "consistent", audit.verdict.explain()
    [told] = [f for f in audit.findings if f.kind == "filtered"]
    a = np.exp(-1.0 / LATE)
    # A recursive average is one of the filters that are looked for; when a motion by itself began, and so its
    # delay, is known to a row.
    assert told.factor == pytest.approx(STEP * a / (1.0 - a), abs=1.01 * STEP)


KICK, EVERY, SPAN, CUT = 3.0, 4, 450, 0.15


def late(x: np.ndarray) -> np.ndarray:
    """Behind Butterworth's filter of second order."""
    return np.asarray(lfilter(*butter(2, CUT), x - x[0], axis=0) + x[0])


def in_time(x: np.ndarray) -> np.ndarray:
    """Behind the same forward and backward, which keeps the time."""
    return np.asarray(filtfilt(*butter(2, CUT), x, axis=0))


def steeply(x: np.ndarray) -> np.ndarray:
    """Behind Butterworth's filter of fourth order."""
    return np.asarray(lfilter(*butter(4, CUT), x - x[0], axis=0) + x[0])


def averaged(x: np.ndarray) -> np.ndarray:
    """Behind a recursive average, forward and backward."""
    b, a = [1.0 - 0.8], [1.0, -0.8]
    return np.asarray(filtfilt(b, a, x, axis=0))


def driven(
    damping: float, through: Callable[[np.ndarray], np.ndarray], all_columns: bool = False
) -> tuple[dc.Mechanism, dc.Trajectory]:
    """The pendulum with a motor that holds its torque over `EVERY` steps, by the same method."""
    torque = KICK * np.sin(0.9 * (np.arange(SPAN) // EVERY * EVERY))
    y, rows = np.array([0.4, 0.0]), [np.array([0.4, 0.0])]

    def rate(y: np.ndarray, k: int) -> np.ndarray:
        moment = torque[k] - MASS * GRAVITY * LENGTH * np.sin(y[0]) - damping * y[1]
        return np.array([y[1], moment / (INERTIA + MASS * LENGTH**2)])

    for k in range(SPAN - 1):
        k1 = rate(y, k)
        k2 = rate(y + 0.5 * STEP * k1, k)
        k3 = rate(y + 0.5 * STEP * k2, k)
        k4 = rate(y + STEP * k3, k)
        y = y + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        rows.append(y)
    states, held = through(np.array(rows)), torque[:, None]
    return pendulum(), dc.Trajectory(
        t=STEP * np.arange(SPAN, dtype=float), q=states[:, :1], u=states[:, 1:], coordinates=("pin",),
        speeds=("pin",), forces={"actuator pin": through(held) if all_columns else held},
        provenance=dc.Provenance("by hand"),
    )  # fmt: skip


THROUGH = [late, in_time]
MORE = [steeply, averaged]


@pytest.mark.parametrize(
    ("through", "all_columns"),
    [
        *((f, False) for f in THROUGH),
        *(pytest.param(f, False, marks=pytest.mark.slow) for f in MORE),
        *(pytest.param(f, True, marks=pytest.mark.slow) for f in (in_time, averaged)),
    ],
)
def test_a_filter_hides_no_integrator(
    through: Callable[[np.ndarray], np.ndarray], all_columns: bool
) -> None:
    """Of coordinates and speeds beside a torque that went through none, or of all columns."""
    audit = dc.audit(*driven(DAMPING, through, all_columns))
    assert audit.verdict.kind == "consistent", audit.verdict.explain()
    [told] = [f for f in audit.findings if f.kind == "filtered"]
    # The delay of an analogue filter is b₁/b₀ of its polynomial: √2 and √(4 + 2√2) for Butterworth's.
    warped = 2.0 * np.tan(0.5 * np.pi * CUT)
    of_unit: dict[Callable[[np.ndarray], np.ndarray], float] = {
        late: np.sqrt(2.0),
        steeply: np.sqrt(4.0 + 2.0 * np.sqrt(2.0)),
    }
    assert told.factor == pytest.approx(STEP * of_unit.get(through, 0.0) / warped, rel=1e-4)
    # The classical method is exact to h⁵: 1e-9 of the energy that flows.
    assert audit.integrator is not None and audit.attribution is not None
    assert "rk4" in audit.integrator.names
    assert abs(audit.attribution.integrator.energy) < 1e-8 * audit.ledger.energy_exchanged


@pytest.mark.parametrize(
    "through", [*THROUGH, *(pytest.param(f, marks=pytest.mark.slow) for f in MORE)]
)
def test_a_filter_hides_no_mistake(through: Callable[[np.ndarray], np.ndarray]) -> None:
    audit = dc.audit(*driven(1.5 * DAMPING, through))
    assert audit.verdict.kind == "equation-error", audit.verdict.explain()
    [cause] = audit.causes
    assert (cause.kind, cause.element) == ("damping", "pin")
    assert cause.size == pytest.approx(1.5 * DAMPING, rel=1e-3)


@pytest.mark.parametrize("zero", [0.002, 0.03, -0.05])
def test_a_pendulums_zero_is_put_right(zero: float) -> None:
    """A mass centre beside the bar does the same, and gravity of another direction."""
    run = swung()
    audit = dc.audit(pendulum(), replace(run, q=run.q + zero))
    assert audit.verdict.kind == "consistent" and not audit.causes
    [told] = [f for f in audit.findings if f.kind == "zero-offset"]
    assert told.factor == pytest.approx(zero, rel=1e-9)


def test_what_attenuates_next_to_nothing_is_no_filter() -> None:
    """Half of what is within two per cent of the Nyquist frequency: errors of steps look like that."""
    assert not LowPass((0.0, 4e-8), trapezoid=True, both_ways=True, forces=False).low_pass
    assert LowPass((0.0, 4e-2), trapezoid=True, both_ways=True, forces=False).low_pass


def test_the_log_itself_went_through_none() -> None:
    audit = dc.audit(pendulum(), swung())
    assert audit.verdict.kind == "consistent"
    assert not [f for f in audit.findings if f.kind == "filtered"]


@pytest.mark.parametrize(("high", "reached"), [(0.9, True), (1.1, False)])
def test_limits_that_rows_reach(high: float, reached: bool) -> None:
    run = log(SYSTEM, accelerations=False)
    beyond = (float(run.q[:, 0].min()) - 1.0, high * float(run.q[:, 0].max()))
    report = ImportReport(
        "a file", ignored=(Remark.logged("slide", "limits", "limit slide", beyond),)
    )
    assert limits_reached(run, report) == (["limit slide"] if reached else [])


BLOCK, SPRING, DAMPER, RUB, WIDTH = 1.1, 90.0, 0.05, 0.4, 0.05


def rubbing(damper: float) -> dc.Trajectory:
    """A block on a spring with dry friction by Heun's method, behind a filter of second order."""

    def rate(y: np.ndarray) -> np.ndarray:
        force = -SPRING * y[0] - RUB * np.tanh(y[1] / WIDTH) - damper * y[1]
        return np.array([y[1], force / BLOCK])

    rows = [np.array([0.1, 0.0])]
    for _ in range(1000):
        y = rows[-1]
        first = rate(y)
        rows.append(y + STEP / 2.0 * (first + rate(y + STEP * first)))
    y = np.array(rows)
    y = (lfilter(*butter(2, 0.24), y - y[0], axis=0) + y[0])[50:-50]
    return dc.Trajectory(
        t=STEP * np.arange(len(y), dtype=float), q=y[:, :1], u=y[:, 1:],
        coordinates=("slide",), speeds=("slide",), provenance=dc.Provenance("by hand"),
    )  # fmt: skip


@pytest.mark.parametrize("factor", [1.6, 6.0])
def test_a_damper_behind_a_filter_is_no_matter_of_adaptive_steps(factor: float) -> None:
    """The log alone does not tell it from a step of first order; no method of adaptive steps has one."""
    model = dc.Mechanism(
        [dc.point_mass("block", BLOCK)],
        [dc.prismatic("slide", "ground", "block", "x", stiffness=SPRING, damping=DAMPER)],
        forces=[dc.forces.joint_friction("rub", "slide", RUB, width=WIDTH)],
    )
    for damper, kinds in (
        (DAMPER, {"consistent"}),
        (factor * DAMPER, {"equation-error", "unresolved"}),
    ):
        audit = dc.audit(model, rubbing(damper))
        assert audit.verdict.kind in kinds, audit.verdict.explain()
        # Heun's method adds (ωh)⁴/4 of an oscillator's energy in a step: at most 1.2e-5 J of 0.45 J in all.
        assert audit.attribution is not None
        share = audit.attribution.integrator
        assert abs(share.energy) < 2.0 * share.error + 1.2e-5
