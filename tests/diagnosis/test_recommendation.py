"""recommend: the advice keeps its tolerance when run again, and the next cheaper setting does not."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.recommend import families as settings_of_solvers
from deltac.diagnosis.recommend.recommend import Search, SolverCandidate
from deltac.diagnosis.recommend.work_precision import (
    Deadline,
    Family,
    OutOfTime,
    OverBudget,
    Trial,
    Trials,
    distance,
)
from deltac.diagnosis.study.curves import common_times
from deltac.problems import ball_on_compliant_floor


def share_of_ranges(run: dc.Trajectory, exact: dc.Trajectory) -> float:
    """Largest error of angles, and of speeds, as a share of the largest range (all are angles here)."""
    errors = []
    for a, b in ((run.q, exact.q), (run.u, exact.u)):
        errors.append(float(np.abs(a - b).max() / np.ptp(b, axis=0).max()))
    return max(errors)


def test_the_advice_is_kept_against_an_exact_motion() -> None:
    """Judged by Taylor's method, which recommend does not use; its estimate is good to a few per cent."""
    problem = dc.problems.load("triple-pendulum")
    advice = dc.recommend(problem, duration=1.0, tolerance=1e-6, solvers=("ode8", "ode5", "ode4"))
    assert advice.verified
    assert advice.exit_code == 0
    assert advice.best is not None
    assert advice.coarser is not None
    errors = []
    for step in (advice.step, advice.coarser.setting):
        run = dc.simulate(problem.mechanism, problem.state, 1.0, step, advice.solver)  # type: ignore[arg-type]
        exact = dc.simulate(problem.mechanism, problem.state, 1.0, step, "taylor")
        ledger = dc.balance(problem.mechanism, run, testing=("wang",))
        energy = float(np.abs(ledger.delta_c["wang"]).max() / ledger.reference_energy)
        errors.append(max(energy, share_of_ranges(run, exact)))
    assert errors[0] <= 1.1e-6
    assert errors[1] > 0.9e-6
    assert all(other.seconds >= advice.best.seconds / 1.2 for other in advice.prospects[1:])
    tried = {trial.solver for trial in advice.trials}
    assert "ode4" in tried or any("ode4" in note for note in advice.notes)
    json.dumps(advice.to_dict(), allow_nan=False)


def _unused(setting: float) -> dc.Trajectory:
    raise AssertionError


class Invented:
    """Trials of solvers whose errors and times follow laws: what a search should find is known."""

    reference_energy, still, native = 1.0, False, math.inf

    def __init__(self, constant: dict[str, float], verified_error: float = 1.0) -> None:
        self.constant, self.verified_error, self.trials, self.verifications = (
            constant,
            verified_error,
            0,
            0,
        )

    def of(self, family: Family, setting: float) -> Trial:
        self.trials += 1
        assert family.order is not None
        error = self.constant[family.name] * setting**family.order
        if error > 1.0:
            return Trial(family.name, "step", setting, math.inf, math.nan, math.inf, 0, "blew up")
        seconds = self.seconds(family, setting)
        return Trial(family.name, "step", setting, 0.1 * error, error, seconds, family.stages)

    def seconds(self, family: Family, setting: float) -> float:
        return 1e-4 + 1e-6 * family.stages / setting

    def verified(self, family: Family, trial: Trial) -> Trial:
        self.verifications += 1
        return replace(trial, motion=self.verified_error * trial.motion, verified=True)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("stiff", [1.0, 1e3])
@pytest.mark.parametrize("missed", [1.0, 30.0])
def test_the_prediction_finds_what_trying_all_would(
    tolerance: float, stiff: float, missed: float
) -> None:
    """Also where verification finds errors a number of times as large as the search's estimates."""
    settings = tuple(0.05 / 1.2**k for k in range(30))

    families = [
        Family(f"p{p}", p, p, settings, "step", _unused, lambda _: []) for p in (8, 5, 4, 2)
    ]
    trials = Invented({f.name: stiff ** (f.order or 1) for f in families}, missed)
    asked = (tolerance, tolerance)
    candidates = [SolverCandidate(family, asked, 1.0) for family in families]
    search = Search(candidates, trials, asked, Deadline(), None)  # type: ignore[arg-type]
    best = search.cheapest()
    effort = trials.trials, trials.verifications
    every = [
        trial
        for family in families
        for h in settings
        if (trial := trials.verified(family, trials.of(family, h))).passes(*asked)
    ]
    if not every:
        assert best is None
        assert all(candidate.reason for candidate in candidates)
        return
    assert best is not None
    advice = best.trials[best.place]
    assert advice.verified and advice.passes(*asked)
    assert advice.seconds <= 1.25 * min(trial.seconds for trial in every)
    assert effort[0] <= 24 and effort[1] <= (1 if missed == 1.0 else 8)
    if best.place > 0:
        coarser = trials.of(best.family, settings[best.place - 1])
        assert not trials.verified(best.family, coarser).passes(*asked)


def test_what_cannot_be_the_cheapest_is_not_run() -> None:
    """One coarse run of order 8 tells how fast the motion is, and so what order 1 needs at least."""
    settings = tuple(0.05 / 1.2**k for k in range(90))
    families = [
        Family(name, order, order, settings, "step", _unused, lambda _: [])
        for name, order in (("p8", 8), ("p1", 1))
    ]
    asked = (1e-6, 1e-6)
    trials = Invented({"p8": 12.0**8, "p1": 12.0})
    candidates = [SolverCandidate(family, asked, 1.0) for family in families]
    best = Search(candidates, trials, asked, Deadline(), None).cheapest()  # type: ignore[arg-type]
    assert best is candidates[0] and not candidates[1].trials
    # Order 1 has an error of 12 h: h = 1e-6 / 12, and by the bound at least half as many steps.
    assert candidates[1].fewest(candidates[0].rate) == pytest.approx(12e6 / 2, rel=1e-9)


def test_a_solver_that_was_given_up_returns_where_the_others_fail() -> None:
    """The order says that the first is cheap, so the second is stopped; then the first keeps nothing."""

    class Slow(Invented):
        def __init__(self) -> None:
            super().__init__({"first": 1.0, "second": 1.0})
            self.stopped = 0

        def of(self, family: Family, setting: float) -> Trial:
            if family.name == "second" and not self.stopped:
                self.stopped += 1
                raise OverBudget("it takes long")
            trial = super().of(family, setting)
            floor = 1e-2 if family.name == "first" else 0.0
            return replace(trial, motion=trial.motion + floor)

    settings = tuple(0.05 / 1.2**k for k in range(60))
    families = [
        Family(name, 4, 4, settings, "step", _unused, lambda _: []) for name in ("first", "second")
    ]
    asked = (1e-6, 1e-6)
    trials = Slow()
    candidates = [SolverCandidate(family, asked, 1.0) for family in families]
    best = Search(candidates, trials, asked, Deadline(), None).cheapest()  # type: ignore[arg-type]
    assert trials.stopped == 1
    assert best is candidates[1] and best.trials[best.passing].verified


def test_nothing_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settings_of_solvers, "MOST", 20_000)
    problem = dc.problems.load("simple-pendulum")
    advice = dc.recommend(problem, duration=0.2, tolerance=2e-13, solvers=("ode1",))
    assert advice.best is None
    assert advice.exit_code == 1
    assert advice.step is None
    assert "Nothing that was tried" in advice.explain()
    assert "ode1" in advice.explain()


def test_a_run_that_breaks_down_is_not_recommended() -> None:
    """A spring of ω = 1e4 rad/s: explicit steps above 2.8e-4 s blow up, and are passed over."""
    mass = dc.point_mass("mass", 1.0)
    mechanism = dc.Mechanism(
        bodies=[mass],
        joints=[dc.prismatic("slide", "ground", "mass", axis=(1, 0, 0))],
        forces=[dc.forces.joint_spring("spring", "slide", stiffness=1e8)],
    )
    state = mechanism.state({"slide": 1e-3})
    advice = dc.recommend(mechanism, state, 0.5, 1e-3, solvers=("ode4",))
    assert advice.best is not None
    assert advice.best.setting < 2.8e-4
    assert any(trial.message for trial in advice.trials)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, "tolerance is 0.0"),
        ({"tolerance": 1e-30}, "nothing but rounding"),
        ({"duration": math.nan}, "duration is nan"),
        ({"solvers": ()}, "solvers is empty"),
        ({"solvers": ("ode55",)}, "did you mean"),
        ({"solvers": ("taylor",)}, "nothing to choose from"),
        ({"solvers": ("mujoco:rk4",)}, "needs a MuJoCo model"),
        ({"controller": lambda model, data: None}, "our own solvers take a Controller"),
    ],
)
def test_bad_input(options: dict[str, object], message: str) -> None:
    with pytest.raises(dc.InputError, match=message):
        dc.recommend("simple-pendulum", **options)  # type: ignore[arg-type]


def test_a_solver_that_cannot_do_it_is_left_out_with_the_reason() -> None:
    """The discrete gradient refuses what is driven; alone, that is an error, and no matter of accuracy."""
    options: dict[str, Any] = {"duration": 0.5, "tolerance": 1e-6}
    advice = dc.recommend("driven-pendulum", solvers=("ode5", "discrete-gradient"), **options)
    assert advice.solver == "ode5"
    assert any("discrete-gradient" in note for note in advice.notes)  # not run, or left out
    with pytest.raises(dc.InputError, match="no solver can be used.*conserves the energy"):
        dc.recommend("driven-pendulum", solvers=("discrete-gradient",), **options)


RATE, SLOW, KICK = 8e3, 2 * math.pi, 2e-3  # 1/s; rad/s; of the fast speed to the slow one's range


def kicked() -> tuple[dc.Mechanism, dc.State]:
    """A slow oscillator, and beside it a small speed that a damper takes in 1/8000 s."""
    masses = [dc.point_mass("slow", 1.0), dc.point_mass("fast", 1.0)]
    mechanism = dc.Mechanism(
        bodies=masses,
        joints=[
            dc.prismatic("slow", "ground", "slow", axis=(1, 0, 0)),
            dc.prismatic("fast", "ground", "fast", axis=(1, 0, 0)),
        ],
        forces=[
            dc.forces.joint_spring("spring", "slow", stiffness=SLOW**2),
            dc.forces.joint_damper("damper", "fast", damping=RATE),
        ],
    )
    return mechanism, mechanism.state({"slow": 1.0}, {"fast": KICK * 2 * SLOW})


def error_of_the_kicked(run: dc.Trajectory) -> float:
    """Motion error of every row by the closed form: cos and exp."""
    t, kick = run.t, KICK * 2 * SLOW
    decay = np.exp(-RATE * t)
    q = np.column_stack([np.cos(SLOW * t), kick / RATE * (1 - decay)])
    u = np.column_stack([-SLOW * np.sin(SLOW * t), kick * decay])
    ranges = 2.0, 2 * SLOW
    return float(max(np.abs(run.q - q).max() / ranges[0], np.abs(run.u - u).max() / ranges[1]))


@pytest.mark.parametrize(
    "solver",
    [
        "ode3",
        *(pytest.param(s, marks=pytest.mark.slow) for s in ("ode8", "Radau", "DOP853")),
        pytest.param("generalized-alpha", marks=pytest.mark.slow),
        pytest.param("implicit-midpoint", marks=pytest.mark.slow),
    ],
)
def test_a_transient_at_the_start_counts(solver: str) -> None:
    """The kick is 2e-3 of the range and gone within a few steps; its energy is too small to decide."""
    mechanism, state = kicked()
    tolerance = 2e-4
    advice = dc.recommend(mechanism, state, 1.0, tolerance, solvers=(solver,), time_limit=600)
    assert advice.verified
    best, coarser = advice.best, advice.coarser
    assert best is not None

    def error(trial: Trial, spacing: float) -> float:
        chosen = dc.solvers.by_name(solver, None if trial.knob == "step" else trial.setting)
        run = dc.simulate(mechanism, state, 1.0, spacing, chosen)
        return error_of_the_kicked(run)

    if best.knob == "tolerance":  # the rows are where the user wants them
        assert all(error(best, spacing) <= 1.05 * tolerance for spacing in (5e-3, 1e-4))
        return
    assert best.motion <= tolerance
    assert best.motion == pytest.approx(error(best, best.setting), rel=0.01)  # 16⁻² for order 2
    assert coarser is not None
    assert error(coarser, coarser.setting) > tolerance


def test_a_run_is_verified_at_all_of_its_rows() -> None:
    """The reference has a row wherever the run has one; an adaptive run's rows are dense at the start."""
    mechanism, state = kicked()
    options: Any = (mechanism, state, 1.0, ("ode4", "DOP853"), {}, Deadline())
    (fixed, adaptive), _ = settings_of_solvers.families(mechanism, *options)
    (whole,) = fixed.pieces(1 / 40_000)
    assert len(whole.run()) == 40_001
    pieces = adaptive.pieces(1e-4)
    assert pieces[-1].run().t[1] == pytest.approx(1e-9)
    for piece in (whole, *pieces):
        t = piece.run().t
        _, (rows, others) = common_times([t, piece.finer(piece.divisors[2]).t])
        assert np.array_equal(rows, np.arange(len(t)))
        assert np.array_equal(others, rows)


def test_nothing_that_moves_is_nothing_to_judge_by() -> None:
    rod = dc.Mechanism(
        [dc.rod("rod", 1.0, 1.0, along="-z")],
        [dc.revolute("hinge", "ground", "rod", axis="y")],
        gravity=(0, 0, -9.81),
    )
    advice = dc.recommend(rod, rod.state(), 1.0, solvers=("ode1", "ode4"))
    assert advice.best is None and advice.still
    assert advice.exit_code == 3


def test_a_body_that_turns_freely_moves_though_it_exchanges_nothing() -> None:
    problem = dc.problems.load("torque-free-box")
    box = replace(problem.mechanism, gravity=(0, 0, 0))
    advice = dc.recommend(box, problem.state, 1.0, 1e-5, solvers=("ode5",))
    assert advice.verified and advice.exit_code == 0
    # K of the box: ½ 10 kg (2² + 2² + 8²) m²/s² and ½ Σ I ω² with ω = (0.1, 5, 0.1).
    kinetic = 360 + 0.5 * (0.80833333 * 0.01 + 0.68333333 * 25 + 0.14166667 * 0.01)
    assert advice.reference_energy == pytest.approx(kinetic, rel=1e-6)


def test_what_does_not_move_has_no_range_to_be_right_within() -> None:
    """A box in free fall does not turn but for rounding, of which no share is an error."""
    box = dc.bodies.box("box", 1.0, (0.1, 0.2, 0.3))
    falling = dc.Mechanism([box], [dc.free("base", "box")], gravity=(0, 0, -9.81))
    advice = dc.recommend(falling, falling.state(), 1.0, solvers=("ode4",))
    # ode4 is exact on a parabola: nothing but rounding is left at the coarsest step there is.
    assert advice.verified
    assert advice.step == pytest.approx(1.0 / settings_of_solvers.FEWEST)


def test_a_search_ends_in_its_time_with_the_best_it_has() -> None:
    deadline = Deadline(0.0)
    with pytest.raises(OutOfTime):
        deadline.check()
    deadline.lift()
    deadline.check()

    class Halting(Invented):
        """Time is up when the second solver comes to its turn."""

        def of(self, family: Family, setting: float) -> Trial:
            if family.name == "second":
                Deadline(0.0).check()
            return super().of(family, setting)

    settings = tuple(0.05 / 1.2**k for k in range(30))
    families = [
        Family(name, 4, 4, settings, "step", _unused, lambda _: []) for name in ("first", "second")
    ]
    asked = (1e-4, 1e-4)
    candidates = [SolverCandidate(family, asked, 1.0) for family in families]
    trials = Halting({"first": 1.0, "second": 1.0})
    search = Search(candidates, trials, asked, Deadline(), None)  # type: ignore[arg-type]
    best = search.cheapest()
    # The first had one coarse run, which keeps 1e-4 and is verified although the time is over.
    assert best is candidates[0] and best.trials[best.passing].verified
    assert search.notes and trials.verifications == 1


def test_a_model_without_duration_is_asked_for_one() -> None:
    mechanism = dc.problems.load("simple-pendulum").mechanism
    with pytest.raises(dc.InputError, match="duration: say how long"):
        dc.recommend(mechanism)


def test_distance_is_by_unit_and_at_common_times() -> None:
    """A cart-pole's metres and radians have their own scales."""
    problem = dc.problems.load("elastic-pendulum")
    run = dc.simulate(problem.mechanism, problem.state, 1.0, 0.01)
    finer = dc.simulate(problem.mechanism, problem.state, 1.0, 0.004)
    _, (rows, others) = common_times([run.t, finer.t])
    assert np.allclose(run.t[rows], finer.t[others], atol=1e-12)
    assert len(rows) == 51  # every 0.02 s
    assert distance(problem.mechanism, run, run) == 0.0
    assert 0.0 < distance(problem.mechanism, run, finer) < 1e-4
    shifted = dc.simulate(problem.mechanism, problem.state, 0.9, 0.3)
    assert distance(problem.mechanism, run, shifted) < 1.0


ARM = """
<mujoco model="arm">
 <worldbody>
  <body pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="0.05"/>
   <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
   <body pos="0.3 0 0"><joint name="elbow" axis="0 1 0" damping="0.02"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/></body></body>
 </worldbody>
 <actuator><motor name="motor" joint="shoulder" gear="3"/></actuator>
</mujoco>"""

SLIDER = """
<mujoco model="slider">
 <worldbody>
  <body pos="0 0 0"><joint name="slide" type="slide" axis="1 0 0" stiffness="2e4" damping="40"/>
   <geom type="sphere" size="0.05" mass="1"/>
   <body pos="0 0 0"><joint name="swing" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02"/></body></body>
 </worldbody>
 <actuator><motor name="push" joint="slide" gear="30"/></actuator>
</mujoco>"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "tolerance", "solvers"),
    [
        pytest.param(ARM, 1e-6, ("mujoco:rk4", "mujoco:euler"), id="arm"),
        pytest.param(
            SLIDER,
            1e-3,
            ("mujoco:rk4", "mujoco:implicitfast"),
            id="stiff slider",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_mujoco_integrators_on_a_signal_of_the_users(
    text: str, tolerance: float, solvers: tuple[str, ...]
) -> None:
    """The advice, run again, against MuJoCo's own RK4 at a step 8 times as small."""
    mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")
    model = mujoco.MjModel.from_xml_string(text)

    def control(model: object, data: Any) -> None:
        data.ctrl[0] = 0.4

    advice = dc.recommend(
        model, duration=0.5, tolerance=tolerance, solvers=solvers, controller=control
    )
    assert advice.verified
    assert advice.best is not None
    mechanism, _ = dc.read_mechanism(model)

    def run(solver: str, step: float) -> dc.Trajectory:
        integrator = solver.removeprefix("mujoco:")
        return dc.run_mujoco(model, 0.5, controller=control, step=step, integrator=integrator)

    exact = run("mujoco:rk4", advice.best.setting / 8)
    assert advice.best.verified
    assert (
        distance(mechanism, run(advice.best.solver, advice.best.setting), exact) <= 1.1 * tolerance
    )
    assert advice.coarser is not None
    coarser = run(advice.best.solver, advice.coarser.setting)
    ledger = dc.balance(mechanism, coarser, testing=("wang",))
    energy = float(np.abs(ledger.delta_c["wang"]).max()) / ledger.reference_energy
    exact = run("mujoco:rk4", advice.coarser.setting / 8)
    # What fails is one of the two, or the run itself; the energy counts corrections too.
    assert max(energy, distance(mechanism, coarser, exact)) > 0.5 * tolerance


@pytest.mark.slow
@pytest.mark.parametrize("solvers", [None, ("ode3",), ("Radau",)])
def test_the_stiff_governor(solvers: tuple[str, ...] | None) -> None:
    """The advice keeps 1e-4 against Radau at its tightest, whichever solver it names."""
    problem = dc.problems.load("stiff-governor")
    advice = dc.recommend(problem, duration=1.0, tolerance=1e-4, solvers=solvers)
    assert advice.verified
    best = advice.best
    assert best is not None
    stepping = best.knob == "step"
    chosen = dc.solvers.by_name(best.solver, None if stepping else best.setting)
    step = best.setting if stepping else 1e-4
    run = dc.simulate(problem.mechanism, problem.state, 1.0, step, chosen)
    exact = dc.simulate(
        problem.mechanism, problem.state, 1.0, float(run.t[1]), dc.solvers.Scipy("Radau", 1e-11)
    )
    assert distance(problem.mechanism, run, exact) <= 1.1e-4


@pytest.mark.parametrize("solver", ["ode2", "ode3", "ode4", "ode5", "ode8", "DOP853", "RK45"])
@pytest.mark.parametrize("steps", [4_000, 10_000, 16_000])
def test_the_error_told_at_kinks_bounds_that_of_the_closed_form(solver: str, steps: int) -> None:
    """A ball that bounces on a spring: every touch is a kink, met by each run in its own way."""
    problem = dc.problems.load("ball-on-compliant-floor")
    state, duration = problem.state, problem.duration
    options: Any = (problem.mechanism, state, duration, (solver,), {}, Deadline())
    (family,), _ = settings_of_solvers.families(problem, *options)
    setting = duration / steps if family.knob == "step" else 10.0 ** -(6 + steps / 4_000)
    whole = replace(family, pieces=lambda setting: family.pieces(setting)[:1])
    trials = Trials(problem.mechanism, state, 1e-6)
    told = trials.verified(whole, Trial(solver, family.knob, setting, 0.0, 0.0, 0.0, 0))
    run = family.pieces(setting)[0].run()
    z = np.array([ball_on_compliant_floor.height(t) for t in run.t])
    # K + V is that of the start, and the ball falls until it is deepest, and again from every top.
    g, k, height = 9.81, 2e3, 0.5
    size = np.sqrt(2 * g * (height - z) - k * np.minimum(z, 0.0) ** 2)
    error = max(
        float(np.abs(run.coordinate("z") - z).max() / np.ptp(z)),
        float(np.abs(np.abs(run.speed("z")) - size)[size > 0.1].max() / (2 * size.max())),
    )
    assert told.verified
    assert 0.99 * error <= told.motion <= 1.02 * error + 1.1 * told.doubt
    assert told.doubt <= max(0.06 * told.motion, 0.06e-6)
