"""The thesis's study: its table, its results, its figures, and the statements that they support.

Where numbers are compared, they come from somewhere else: sums by hand, the library's own
references (calculated by another program), or SciPy's integrator on the hand-written equations.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path

import matplotlib.colors
import matplotlib.image
import numpy as np
import pytest
import thesis
from scipy.integrate import solve_ivp
from thesis import EXPERIMENTS, Reproduction, Result, reproduce, write
from thesis.experiments import PublishedExperiment
from thesis.measures import euler_relation
from thesis.run import main
from thesis.runs import (
    Run,
    absolute_angles,
    perform,
    problem,
    rates,
    totals,
    trajectory_of,
)

import deltac as dc
from deltac import problems
from deltac.errors import InputError
from deltac.problems.triple_pendulum_equations import HandEquations
from deltac.report.style import COLOURS

pytestmark = pytest.mark.case_study

KEYS = ["figure", "run", "quantity", "thesis", "value", "unit", "rule", "agrees", "difference"]
KEYS.append("source")
TESTED = ("4.1", "4.2", "4.3", "4.4", "4.6", "4.7", "4.9", "4.10")


@pytest.fixture(scope="module")
def whole() -> Reproduction:
    return reproduce()


def rows(reproduction: Reproduction, figure: str, quantity: str) -> dict[str, Result]:
    """The results of one quantity by run."""
    found = [r for r in reproduction.results if (r.figure, r.quantity) == (figure, quantity)]
    by_run = {r.run: r for r in found}
    assert found and len(by_run) == len(found)
    return by_run


# --- the table ------------------------------------------------------------------------------------


def test_the_table_has_the_ten_figures_in_order() -> None:
    assert [e.figure for e in EXPERIMENTS] == [f"4.{n}" for n in range(1, 11)]


def test_runs_that_serve_several_figures_are_run_once(whole: Reproduction) -> None:
    named = [run for e in whole.experiments for run in e.all_runs.values()]
    assert set(named) == set(whole.outcomes)
    assert len(whole.outcomes) < len(named)


def test_unknown_figure_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"'5\.1'.*4\.1, 4\.2, .*4\.10"):
        reproduce(["4.1", "5.1"])
    with pytest.raises(InputError, match=r"known: 4\.1"):
        reproduce([])


# --- numbers --------------------------------------------------------------------------------------


def test_kinetic_energies_by_hand(whole: Reproduction) -> None:
    # Only bar 1 turns, so bars 2 and 3 ride on its end, l1 = 0.1 m away:
    # K = ½ (m1 l1²/3 + (m2 + m3) l1²) ω1² with 10, 30, 20 N at g = 9.8 m/s².
    inertia = (10 / 3 + 30 + 20) / 9.8 * 0.1**2
    for figure, rate in (("4.3", 10.0), ("4.4", 1.0 * 0.75)):
        (row,) = rows(whole, figure, "K(0)").values()
        assert row.value == pytest.approx(0.5 * inertia * rate**2, rel=1e-14)
        assert row.agrees is (
            True if figure == "4.3" else None
        )  # of 4.4 the thesis gives no number


def test_final_angles_are_those_that_scipy_finds(whole: Reproduction) -> None:
    hand = HandEquations.of(problem("standard").mechanism.parameters)
    start = np.radians([0.0, 60.0, 15.0, 0.0, 0.0, 0.0])
    exact = solve_ivp(
        lambda t, x: np.concatenate([x[3:], hand.free(t, x[:3], x[3:])]),
        (0.0, 10.0),
        start,
        "DOP853",
        rtol=1e-12,
        atol=1e-12,
    ).y[:3, -1]
    for bar in range(3):
        found = rows(whole, "4.1", f"θ{bar + 1} at 10 s")
        # The error that halving-by-ten leaves at h = 0.0001 s, and SciPy's own, are below 1e-8 rad.
        assert math.radians(found["h = 0.0001 s"].value) == pytest.approx(exact[bar], abs=1e-8)
        assert math.radians(found["h = 0.001 s"].value) == pytest.approx(exact[bar], abs=1e-6)


@pytest.mark.parametrize("figure", ["4.1", "4.3", "4.4"])
def test_in_loop_errors_fall_by_the_solvers_order(whole: Reproduction, figure: str) -> None:
    # ode5 has order 5: ten times the step is 10⁵ times the error, here within one order of it.
    for function in ("Wang", "Liu–Huston"):
        found = rows(whole, figure, f"max {function} |ΔC|")
        fall = math.log10(found["h = 0.01 s"].value / found["h = 0.001 s"].value)
        assert 4.0 < fall < 7.0
        assert found["h = 0.0001 s"].value < found["h = 0.001 s"].value


def test_observed_order_of_fig_4_1_is_the_solvers(whole: Reproduction) -> None:
    (row,) = rows(whole, "4.1", "observed order of ΔC").values()
    assert row.value == pytest.approx(5.0, abs=0.5)
    assert row.agrees is None and row.rule == "reported"


def test_torque_of_fig_4_5_is_the_librarys_reference(whole: Reproduction) -> None:
    known = {r.quantity: r for r in problems.load("driven-triple-pendulum").reference}
    for ours, theirs in (("least M1", "least"), ("largest M1", "largest")):
        (row,) = rows(whole, "4.5", ours).values()
        # The extreme lies between samples 1 ms apart: its parabola falls off by up to 2e-3 N·m.
        assert row.value == pytest.approx(known[f"{theirs} driving torque M1"].value, abs=2e-3)
    (row,) = rows(whole, "4.5", "difference from M1 by the hand-written equations").values()
    assert row.value < 1e-12  # rounding of 15 N·m


def test_the_drive_in_four_forms_gives_one_total(whole: Reproduction) -> None:
    for figure in ("4.4", "4.6"):
        forms = [r for r in whole.results if r.figure == figure and "four forms" in r.quantity]
        assert forms and all(r.agrees for r in forms)


def test_both_readings_of_the_drive_have_one_work() -> None:
    """(3.2.36), M1 applied: Q = ∫ q̇ᵀF̂_D; (2.5.64), M1 a multiplier: Q = −∫ bᵀλ_m. Never both."""
    run = Run("driven", "ode5", 1e-3)
    log = trajectory_of(run, problem(run.variant).state)
    work = {}
    for variant, channel in (
        ("driven by a logged torque", "actuator M1"),
        ("driven by a constraint", "constraint drive"),
    ):
        forces = {channel: log.forces["prescribed joint1"]}
        read = dataclasses.replace(log, forces=forces, works={}, integrals={})
        ledger = dc.balance(problem(variant).mechanism, read, work="samples", testing=("wang",))
        assert np.abs(ledger.delta_c["wang"]).max() < 1e-9
        work[variant] = ledger.work
    for channel in ("actuator M1", "constraint drive"):
        (own,) = [w for w in work.values() if channel in w]
        # The reference was calculated by another program, to 1e-12; here h = 0.001 s.
        assert own[channel][-1] == pytest.approx(2.291822080477, abs=1e-9)
    assert "constraint drive" not in work["driven by a logged torque"]
    assert "actuator M1" not in work["driven by a constraint"]


def test_a_wrong_torque_changes_the_total_by_its_work() -> None:
    run = Run("driven", "ode5", 1e-3, duration=2.0)
    right, wrong = totals(run), totals(run, 1.01)
    outcome = perform(run)
    motor = outcome.ledger.work["prescribed joint1"]
    for form in ("applied", "multiplier", "prescribed"):
        change = getattr(wrong, form) - getattr(right, form)
        # ΔC = E − E(0) − Q, and the wrong log says that Q is one percent more.
        np.testing.assert_allclose(change, -0.01 * motor, rtol=0, atol=1e-9)
        assert np.abs(change).max() > 1e-3
    assert np.array_equal(wrong.accelerations, right.accelerations)


def test_the_ways_would_differ_for_accelerations_that_do_not_fit_the_torque() -> None:
    outcome = perform(Run("driven", "ode5", 1e-2, duration=1.0))
    run = outcome.trajectory
    assert rates(run).spread < 1e-13
    assert run.udot is not None
    bent = dataclasses.replace(run, udot=run.udot + np.array([0.0, 0.1, 0.0]))
    forms = rates(bent)
    assert forms.torque_spread < 1e-13
    assert forms.spread > 1e-4


def test_the_rate_form_shows_the_mistake_and_no_error_of_a_solver(tmp_path: Path) -> None:
    """(2.4.1): at every sample K̇ + V̇ − Q̇ = 2 g₂ θ̇₂ sin θ₂, g₂ = 8.75 N·m, and zero of any solver's run."""
    study = reproduce(["rate"])
    assert study.agrees and sum(r.judged for r in study.results) == 3
    written = write(study, tmp_path)
    assert [path.name for path in written.figures] == ["figure_rate.png"]
    assert_is_a_picture(written.figures[0])
    outcome = study.outcomes[Run("by hand, sign mistake", "ode5", 1e-3)]
    theta, omega = outcome.trajectory.q[:, :2].sum(axis=1), outcome.trajectory.u[:, :2].sum(axis=1)
    exact = 2 * 8.75 * omega * np.sin(theta)
    np.testing.assert_allclose(outcome.rates["wang"], exact, rtol=0, atol=1e-11)
    np.testing.assert_allclose(outcome.rates["liu-huston"], exact, rtol=0, atol=1e-11)
    euler = perform(Run("by hand", "ode1", 1e-3, duration=2.0))
    assert np.abs(euler.ledger.delta_c["wang"]).max() > 0.1
    assert np.abs(euler.rates["wang"]).max() < 1e-11


def test_the_driven_runs_in_joint_angles_and_in_absolute_ones(whole: Reproduction) -> None:
    """Euler's method by hand, in the thesis's coordinates: (3.1.18)-(3.1.19) with θ1 = sin 0.75 t."""
    pendulum = problem("by hand, driven")
    hand = HandEquations.of(pendulum.mechanism.parameters)
    step, steps = 1e-3, 10_000
    theta, omega = np.radians([60.0, 15.0]), np.zeros(2)
    for k in range(steps):
        rate = hand.driven(k * step, theta, omega)
        theta, omega = theta + step * omega, omega + step * rate
    found = whole.outcomes[Run("by hand, driven", "ode1", step)].trajectory
    np.testing.assert_allclose(absolute_angles(found)[-1, 1:], theta, rtol=0, atol=1e-9)
    (wang,) = (
        r.value
        for r in whole.results
        if (r.run, r.quantity) == ("absolute angles, ode1", "max Wang |ΔC|")
    )
    joint = rows(whole, "4.6", "max Wang |ΔC|")["ode1"].value
    assert wang == pytest.approx(2.6347, abs=1e-4)
    assert joint == pytest.approx(2.6352, abs=1e-4)


def test_the_initial_error_of_fig_4_9_by_hand(whole: Reproduction) -> None:
    """l. 5146: largest |ΔC| up to t = 2 s, from the ledgers."""

    def initial(variant: str, duration: float = 10.0) -> float:
        ledger = whole.outcomes[Run(variant, "ode5", 1e-2, duration)].ledger
        return float(np.abs(ledger.delta_c["wang"][:201]).max())

    rest = initial("standard")
    sizes = [initial("tumbling", 50.0), initial("tumbling, damped", 50.0), initial("fast"), rest]
    assert sizes == pytest.approx([5.1e-4, 2.0e-3, 3.5e-3, 2.8e-4], rel=0.02)
    for run, size in (("no dampers", sizes[0]), ("dampers", sizes[1])):
        (row,) = (
            r
            for r in whole.results
            if r.run == f"{run} / fig. 4.1, h = 0.01 s" and "0–2 s" in r.quantity
        )
        # The row has the smaller ratio of the two functions.
        assert row.value <= size / rest * (1 + 1e-12) and row.agrees is False


def test_a_mistake_shows_and_dampers_do_not_hide_it(whole: Reproduction) -> None:
    for function in ("Wang", "Liu–Huston"):
        found = rows(whole, "4.10", f"max {function} |ΔC|")
        assert found["sign mistake"].value > 1.0
        assert found["sign mistake, dampers"].value > 1.0
        assert found["right equations"].value < 1e-8


def test_chaotic_runs_give_a_horizon_and_others_their_final_angles(whole: Reproduction) -> None:
    for experiment in whole.experiments:
        for label, outcome in whole.of(experiment).items():
            mine = {
                r.quantity for r in whole.results if (r.figure, r.run) == (experiment.figure, label)
            }
            chaotic = outcome.horizon is not None
            assert ("divergence horizon" in mine) == chaotic
            assert (f"θ1 at {outcome.run.duration:g} s" in mine) != chaotic
    # A disturbance of 1e-12 rad needs ten decades to grow to a degree: this takes a while.
    wild = whole.outcomes[Run("tumbling", "ode5", 1e-2, 50.0)]
    assert wild.horizon is not None and 5.0 < wild.horizon < 50.0
    assert whole.outcomes[Run("standard", "ode5", 1e-3)].horizon is None


def test_recording_fewer_samples_changes_no_number() -> None:
    fine = Run("standard", "ode5", 1e-4, duration=0.5)
    outcome = perform(fine)
    assert fine.every == 10
    assert len(outcome.trajectory) == 501
    np.testing.assert_allclose(
        np.degrees(absolute_angles(outcome.trajectory)[0]), [0, 60, 15], rtol=0, atol=1e-12
    )


def test_a_true_motion_constraint_moves_the_pendulum_as_the_prescribed_joint_does(
    whole: Reproduction,
) -> None:
    (row,) = rows(whole, "4.5", "work of the constraint θ̇1 − Aω cos ωt = 0").values()
    # The reference was calculated by another program, to 1e-12.
    assert row.value == pytest.approx(2.291822080477, abs=1e-9)


def test_the_sign_mistake_does_what_its_closed_form_says(whole: Reproduction) -> None:
    # 2 g₂ (1 + cos 60°) with g₂ = (30 N · 0.125 m + 20 N · 0.25 m) = 8.75 N·m is 26.25 J.
    for figure, run in (("4.7", "sign mistake"), ("4.10", "sign mistake, dampers")):
        exact = rows(whole, figure, "Wang's ΔC from −2 g₂ (cos θ₂ − cos θ₂(0)), relative")[run]
        assert exact.value < 1e-8
        assert 26.0 < rows(whole, figure, "max Wang |ΔC|")[run].value < 2 * 8.75 * 1.5 + 1e-6


def test_half_of_eulers_error_shows_in_liu_hustons_function() -> None:
    # LH − W/2 = (h/4) Δ(ṗ·u) + O(h²): relative to the left side what is left over is O(h).
    left = [
        euler_relation(perform(Run("standard", "ode1", step, duration=2.0)))
        for step in (1e-3, 2.5e-4)
    ]
    assert left[0] < 0.1
    assert left[1] < left[0] / 2


@pytest.mark.slow
def test_inexact_accelerations_would_make_the_floor_of_the_thesis() -> None:
    floor = reproduce(["floor"])
    assert floor.agrees
    ratios = {r.run: r for r in floor.results if r.quantity == "ratio of max |ΔC|"}
    assert len(ratios) == 6
    assert all(r.value < 10.0 for run, r in ratios.items() if "1e-9" in run)
    assert max(r.value for run, r in ratios.items() if "1e-10" in run) > 10.0
    first = ratios["4.1, 1e-9, h = 0.001 s / 4.1, 1e-9, h = 0.0001 s"]
    assert 8.0 < first.value < 10.0  # only just, as docs/thesis.md says


# --- results --------------------------------------------------------------------------------------


def test_every_run_reports_its_testing_functions(whole: Reproduction) -> None:
    for experiment in (e for e in whole.experiments if e.figure in TESTED):
        for label, run in experiment.runs.items():
            for quantity in (
                f"Wang |ΔC| at {run.duration:g} s",
                "max Wang |ΔC|",
                "max Liu–Huston |ΔC|",
            ):
                row = rows(whole, experiment.figure, quantity)[label]
                assert row.unit == "J" and 0.0 <= row.value < 100.0


def test_all_agree_but_the_known_differences(whole: Reproduction) -> None:
    assert whole.agrees
    differing = {(r.figure, r.run, r.quantity) for r in whole.differences}
    assert differing == {
        ("4.1", "h = 0.001 s / h = 0.0001 s", "ratio of max |ΔC|"),
        ("4.2", "ode5", "max Wang |ΔC|"),
        ("4.2", "ode5", "max Liu–Huston |ΔC|"),
        ("4.4", "h = 0.001 s / h = 0.0001 s", "ratio of max |ΔC|"),
        ("4.6", "ode4 / ode5", "ratio of max |ΔC|"),
        ("4.7", "right equations", "max Wang |ΔC|"),
        *(
            ("4.9", f"{run} / fig. {other}, h = 0.01 s", "ratio of max |ΔC| over 0–2 s")
            for run in ("no dampers", "dampers")
            for other in ("4.1", "4.3")
        ),
    }
    assert all(r.difference for r in whole.differences)


def test_a_difference_that_is_not_known_makes_the_study_disagree(whole: Reproduction) -> None:
    spoilt = [dataclasses.replace(row, difference="") for row in whole.results]
    assert not dataclasses.replace(whole, results=tuple(spoilt)).agrees


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.slow  # the command does so below
def test_figures_and_results_are_written(whole: Reproduction, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    seen: list[float] = []
    written = write(whole, folder, seen.append)
    assert seen == sorted(seen) and seen[0] >= 0.0 and seen[-1] <= 1.0
    names = {f"figure_4_{n}.png" for n in range(1, 11)} | {"results.json"}
    assert {path.name for path in folder.iterdir()} == names  # and no temporary files
    assert [path.name for path in written.figures] == [f"figure_4_{n}.png" for n in range(1, 11)]
    for path in written.figures:
        assert_is_a_picture(path)
    entries = json.loads(written.results.read_text(encoding="utf-8"))
    assert_results(entries)
    assert {entry["figure"] for entry in entries} == {e.figure for e in EXPERIMENTS}


def assert_is_a_picture(path: Path) -> None:
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    pixels = matplotlib.image.imread(path)[..., :3]
    assert min(pixels.shape[:2]) > 500
    # Neither blank nor mere text: a colour of the curves covers some pixels.
    colours = np.array([matplotlib.colors.to_rgb(colour) for colour in COLOURS])
    drawn = [(np.abs(pixels - colour).max(axis=-1) < 0.02).sum() for colour in colours]
    assert max(drawn) > 300


def assert_results(entries: list[dict[str, object]]) -> None:
    for entry in entries:
        assert list(entry) == KEYS
        assert isinstance(entry["value"], float) and math.isfinite(entry["value"])
        assert entry["agrees"] in (True, False, None)
        assert (entry["agrees"] is None) == (entry["rule"] == "reported")
        assert all(isinstance(entry[key], str) for key in ("figure", "run", "quantity", "unit"))
    ids = [(e["figure"], e["run"], e["quantity"], e["rule"]) for e in entries]
    assert len(set(ids)) == len(ids)


def test_a_subset_runs_only_what_it_needs(tmp_path: Path) -> None:
    said: list[float] = []
    reproduction = reproduce(["4.7"], said.append)
    assert [e.figure for e in reproduction.experiments] == ["4.7"]
    assert len(reproduction.outcomes) == 2
    assert said == sorted(said) and said[-1] == 1.0
    written = write(reproduction, tmp_path)
    assert_results(json.loads(written.results.read_text(encoding="utf-8")))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["figure_4_7.png", "results.json"]


@pytest.mark.slow
def test_the_panels_of_the_thesis_are_drawn_on_request(whole: Reproduction, tmp_path: Path) -> None:
    written = write(whole, tmp_path, thesis_axes=True)
    assert written.figures[0].name == "figure_3_1.png"
    assert len(written.figures) == 11
    for path in written.figures:
        assert_is_a_picture(path)


def test_a_folder_that_cannot_be_made_is_bad_input(whole: Reproduction, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        write(whole, tmp_path / "file")


def test_an_existing_result_survives_a_failed_write(tmp_path: Path) -> None:
    from deltac.report.files import write_json

    path = tmp_path / "results.json"
    write_json([1], path)
    with pytest.raises(ValueError, match="Out of range"):
        write_json([math.nan], path)
    assert json.loads(path.read_text()) == [1]
    assert list(tmp_path.iterdir()) == [path]


def test_experiments_are_known_by_their_runs() -> None:
    for experiment in EXPERIMENTS:
        assert isinstance(experiment, PublishedExperiment)
        labels = set(experiment.all_runs)
        for claim in experiment.claims:
            named = claim.run.split(" / ")
            assert set(named) <= labels, claim.run


def test_axes_are_those_that_the_thesis_labels(whole: Reproduction) -> None:
    """Ticks from the transcript, panel by panel; 4.7 and 4.10 show the angles of the right equations."""
    from thesis.drawing import draw

    swing = [-100.0, -50.0, 0.0, 50.0, 100.0]
    decades = {
        "4.1": ([1e-20, 1e-10, 1.0], [1e-20, 1e-10, 1.0]),
        "4.2": ([1e-20, 1e-10, 1.0], [1e-20, 1e-10, 1.0, 1e10]),
        "4.3": ([1e-10, 1.0],) * 2,
        "4.4": ([1e-30, 1e-20, 1e-10],) * 2,
        "4.6": ([1e-20, 1.0],) * 2,
        "4.7": ([1e-10, 1.0],) * 2,
        "4.9": ([1e-10, 1e-5, 1.0],) * 2,
        "4.10": ([1e-10, 1.0],) * 2,
    }
    angles = {
        "4.8": [[-1000.0, 0.0, 1000.0, 2000.0], [-200.0, -100.0, 0.0, 100.0, 200.0]],
        "4.9": [],
    }
    for experiment in whole.experiments:
        panels = draw(whole, experiment, thesis_axes=True).axes
        ticks = []
        for panel in panels:
            low, high = panel.get_ylim()
            low, high = low - 1e-9 * abs(low), high + 1e-9 * abs(high)
            ticks.append([float(y) for y in panel.get_yticks() if low <= y <= high])
        if experiment.shows == "torque":
            assert ticks == [[-15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0]]
            continue
        shown = angles.get(experiment.figure, [swing])
        expected = [*shown, *decades.get(experiment.figure, ())]
        assert len(ticks) == len(expected), experiment.figure
        for panel_ticks, ours in zip(expected, ticks):
            assert ours == pytest.approx(panel_ticks, rel=1e-9), experiment.figure
        if experiment.figure in ("4.7", "4.10"):
            last = whole.outcomes[Run("by hand", "ode5", 1e-3)].trajectory
            drawn = np.asarray(panels[0].lines[0].get_ydata())
            assert drawn[-1] == pytest.approx(np.degrees(absolute_angles(last)[-1, 0]), abs=1.0)
            assert len(panels[0].lines) == 3


# --- the statements in docs/data/thesis/statements.csv ----------------------------------------------


def _documented() -> dict[tuple[str, str, str, str], tuple[str, str]]:
    """Figure, run, quantity and statement, and what is measured and whether it agrees."""
    path = Path(__file__).resolve().parents[2] / "docs" / "data" / "thesis" / "statements.csv"
    rows = list(csv.reader(path.read_text("utf-8").splitlines()))[1:]
    return {(a, b, c, d): (value, agreement.strip("*")) for a, b, c, d, value, agreement in rows}


def test_statements_in_the_documents(whole: Reproduction) -> None:
    """Every statement is there, and its number is the one that is measured."""
    documented = _documented()
    measured = {}
    for row in whole.results:
        if row.thesis is None and row.agrees is None:
            continue
        thesis = "" if row.thesis is None else str(row.thesis)
        thesis = f"{row.thesis:g}" if isinstance(row.thesis, float) else thesis
        thesis += f" ({row.source})" if row.source else ""
        measured[row.figure, row.run, row.quantity, thesis] = row
    assert set(documented) == set(measured)
    for key, row in measured.items():
        value_text, says = documented[key]
        assert says == {True: "agrees", False: "differs", None: ""}[row.agrees], key
        value = float(value_text.split()[0])
        # Rounding decides the last step, and chaos the runs of 50 s: their size only.
        loose = "0.0001" in row.run or row.figure in ("4.8", "4.9") or abs(row.value) < 1e-9
        loose = loose or abs(row.value) > 1e6
        if loose:
            assert abs(row.value) <= 10.0 * abs(value) + 1e-14, key
            assert row.value == 0.0 or abs(row.value) >= 0.1 * abs(value) or abs(value) < 1e-9, key
        else:
            assert row.value == pytest.approx(value, rel=1e-2), key


# --- the command ------------------------------------------------------------------------------------


def command(*arguments: str) -> tuple[int, str, str]:
    script = str(Path(thesis.__file__).parent / "run.py")
    done = subprocess.run([sys.executable, script, *arguments], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def test_the_command_ends_with_the_table_and_the_paths(tmp_path: Path) -> None:
    status, out, err = command("--only", "4.5,4.7", "--out", str(tmp_path))
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert max(map(len, lines[:-2])) <= 100
    for heading in ("experiment", "the thesis reports", "we measure", "agrees?"):
        assert heading in lines[0]
    assert "26.25 J" in out and "yes" in out and "no [1]" in out
    assert f"{tmp_path}" in lines[-2] and f"{tmp_path / 'results.json'}" in lines[-1]
    written = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert {row["figure"] for row in written} == {"4.5", "4.7"}
    assert {p.name for p in tmp_path.glob("*.png")} == {"figure_4_5.png", "figure_4_7.png"}


def test_a_disagreement_is_status_1(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Reproduction, "agrees", property(lambda _: False))
    assert Reproduction((), {}, ()).exit_code == 1


def test_bad_input_is_status_2_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    for arguments, said in (
        (("--out", str(tmp_path / "file")), "file"),
        (("--only", "5.1", "--out", str(tmp_path / "x")), "4.8, 4.9, 4.10"),
        (("--only", ",", "--out", str(tmp_path / "x")), "known: 4.1"),
    ):
        monkeypatch.setattr(sys, "argv", ["run.py", *arguments])
        status, (out, err) = main(), capsys.readouterr()
        assert (status, out) == (2, "") and said in err and "Traceback" not in err
