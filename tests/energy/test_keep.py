"""Ledgers that keep some rows: the same numbers as one of all rows, whichever way they are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import EPS
from deltac.energy import one_pass
from deltac.energy.one_pass import PART, ROWS_A_BLOCK
from deltac.errors import InputError

GROUPS = ("potential", "power", "work", "work_error", "delta_c", "error_bar", "momentum")


def shaken(step: float, rows: int) -> tuple[dc.Mechanism, dc.Trajectory]:
    """A damped pendulum on a cart with a law, pushed by a logged force that is off by 1e-3."""
    mechanism = dc.Mechanism(
        [dc.bodies.frame("cart"), dc.point_mass("bob", 2.0, [0, 0, -0.5])],
        [
            dc.prismatic("shake", "ground", "cart", "x", motion="0.1*sin(5*t)"),
            dc.revolute("hinge", "cart", "bob", "y", damping=0.1),
        ],
        gravity=[0, 0, -9.81],
    )
    t = step * np.arange(rows)
    q, u, udot = np.cos(2 * t), -2 * np.sin(2 * t), -4 * np.cos(2 * t)
    x, v, a = 0.1 * np.sin(5 * t), 0.5 * np.cos(5 * t), -2.5 * np.sin(5 * t)
    torque = 0.5 * udot - np.cos(q) * a + 2 * 9.81 * 0.5 * np.sin(q) + 0.1 * u
    force = np.stack([np.zeros(rows), 1.001 * torque], axis=1)
    run = dc.Trajectory(
        t=t,  # type: ignore[arg-type]
        q=np.stack([x, q], axis=1),
        u=np.stack([v, u], axis=1),
        udot=np.stack([a, udot], axis=1),
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
        forces={"applied hand": force},
    )
    return mechanism, run


# Rows of one block, of several, with a last block of next to nothing; steps with which powers at samples
# do and do not suffice.
@pytest.mark.parametrize(
    "rows", [1001, ROWS_A_BLOCK + 2, 3 * ROWS_A_BLOCK + 1, 3 * ROWS_A_BLOCK + 700]
)
@pytest.mark.parametrize("step", [2e-4, 0.05])
@pytest.mark.parametrize("keep", [1, 60, 10**9])
def test_the_same_numbers(rows: int, step: float, keep: int) -> None:
    mechanism, run = shaken(step, rows)
    full = dc.balance(mechanism, run, work="samples")
    some = dc.balance(mechanism, run, work="samples", keep=keep)
    at = np.searchsorted(run.t, some.t)
    assert some.t[0] == run.t[0] and some.t[-1] == run.t[-1]
    assert (
        min(keep, rows)
        <= len(at)
        <= max(2 * keep, rows / PART * 2) + rows / ROWS_A_BLOCK + 3 + 4 * 4
    )
    assert some.rule == full.rule
    expected = full.at(at)
    size = full.energy_exchanged + float(np.abs(full.potential_energy).max())
    bound = 100 * EPS * size * np.sqrt(rows)  # sums of so many numbers, in another order
    for group in GROUPS:
        found, wanted = getattr(some, group), getattr(expected, group)
        assert list(found) == list(wanted)
        for name in found:
            np.testing.assert_allclose(found[name], wanted[name], rtol=1e-9, atol=bound)
    for name, found_one in full.functions().items():
        assert some.functions()[name]["delta_c"] == pytest.approx(found_one["delta_c"], abs=bound)
    for name in ("kinetic", "potential_energy"):  # all of what moved is among the rows kept
        assert np.ptp(getattr(some, name)) == pytest.approx(np.ptp(getattr(full, name)), rel=1e-9)
    assert some.energy_exchanged == pytest.approx(full.energy_exchanged, rel=1e-9)
    for name, values in full.violation.items():
        assert some.violation[name].max() == values.max()


def test_bits_do_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, run = shaken(2e-4, 3 * ROWS_A_BLOCK + 700)
    ledgers = []
    for threads in ("1", "3"):
        monkeypatch.setenv("DELTAC_THREADS", threads)
        ledgers.append(dc.balance(mechanism, run, work="samples", keep=100))
    one, three = ledgers
    for group in GROUPS:
        for name, values in getattr(one, group).items():
            np.testing.assert_array_equal(values, getattr(three, group)[name])


def test_all_rows_of_a_long_log(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = 3 * ROWS_A_BLOCK + 700
    mechanism, run = shaken(2e-4, rows)
    known = dc.balance(mechanism, run, work="samples")
    monkeypatch.setattr(one_pass, "LONG_RUN", rows)
    ledgers = []
    for threads in ("1", "3"):
        monkeypatch.setenv("DELTAC_THREADS", threads)
        ledgers.append(dc.balance(mechanism, run, work="samples"))
    one, three = ledgers
    assert one.rule == known.rule == "samples" and len(one.t) == rows
    size = known.energy_exchanged + float(np.abs(known.potential_energy).max())
    for group in GROUPS:
        for name, values in getattr(one, group).items():
            np.testing.assert_array_equal(values, getattr(three, group)[name])
            wanted = getattr(known, group)[name]
            np.testing.assert_allclose(
                values, wanted, rtol=1e-9, atol=100 * EPS * size * np.sqrt(rows)
            )
    assert one.energy_exchanged == pytest.approx(known.energy_exchanged, rel=1e-12)


def test_rows_that_are_not_equidistant_are_all_looked_at() -> None:
    mechanism, run = shaken(2e-4, 1500)
    uneven = np.delete(np.arange(1500), [700, 701])
    some = replace(
        run,
        t=run.t[uneven],
        q=run.q[uneven],
        u=run.u[uneven],
        udot=run.udot[uneven] if run.udot is not None else None,
        forces={name: force[uneven] for name, force in run.forces.items()},
    )
    full, kept = dc.balance(mechanism, some), dc.balance(mechanism, some, keep=10)
    assert len(kept.t) <= 16
    assert np.abs(kept.delta_c["wang"]).max() == np.abs(full.delta_c["wang"]).max()
    assert kept.energy_exchanged == full.energy_exchanged


def test_no_rows_are_refused() -> None:
    mechanism, run = shaken(2e-4, 1500)
    with pytest.raises(InputError, match="keep=0"):
        dc.balance(mechanism, run, keep=0)


def test_energy_through_springs_counts_no_more_than_their_work() -> None:
    mechanism = dc.Mechanism(
        [dc.point_mass("bob", 2.0)],
        [dc.prismatic("slide", "ground", "bob", "x")],
        [dc.forces.joint_spring("spring", "slide", stiffness=8.0)],
    )
    rows, step, omega = 3 * ROWS_A_BLOCK + 1, 1e-3, 2.0
    t = step * np.arange(rows)
    q, u, udot = np.cos(omega * t), -omega * np.sin(omega * t), -(omega**2) * np.cos(omega * t)
    run = dc.Trajectory(
        t=t,  # type: ignore[arg-type]
        q=q[:, None],
        u=u[:, None],
        udot=udot[:, None],
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
    )
    full, kept = dc.balance(mechanism, run), dc.balance(mechanism, run, keep=20)
    assert kept.energy_exchanged == pytest.approx(full.energy_exchanged, rel=1e-12)
    # V = 4 q² J goes up and down by 4 J in each quarter of a turn; V and K range over 4 J each.
    turned = omega * t[-1]
    quarters = int(turned // (np.pi / 2))
    rest = 4.0 * abs(np.cos(turned) ** 2 - np.cos(quarters * np.pi / 2) ** 2)
    assert kept.energy_exchanged == pytest.approx(4.0 * quarters + rest + 8.0, rel=1e-5)


def test_ledgers_of_other_functions_of_the_same_mechanism(monkeypatch: pytest.MonkeyPatch) -> None:
    """One with momenta has other columns than the next one without."""
    monkeypatch.setattr(one_pass, "LONG_RUN", 2000)
    mechanism, run = shaken(1e-3, 4001)
    first = dc.balance(mechanism, run, work="samples", testing=("wang", "momentum"))
    second = dc.balance(mechanism, run, work="samples", testing=("wang",))
    # The sums are the same, in another order of columns.
    assert second.delta_c["wang"] == pytest.approx(
        first.delta_c["wang"], rel=64 * EPS, abs=64 * EPS
    )
