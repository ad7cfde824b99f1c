"""Pages of motions that nobody judged."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from deltac.arrays import LONG_LOG
from deltac.diagnosis import before_blow_up, read_log
from deltac.energy import Ledger
from deltac.mechanism import Mechanism
from deltac.models import ModelLike, StateLike, load_model
from deltac.report.page.content import made, moving
from deltac.report.page.parts import Chapter, Page
from deltac.report.panels import by_name, energy_plots, motions
from deltac.results import number
from deltac.simulation import positive
from deltac.trajectories import MappingLike, Trajectory
from deltac.verbs import balance, read_trajectory, simulate

VIEW_STEP, VIEW_SOLVER, DURATION = 1e-3, "ode5", 5.0
"""Of a motion whose model says nothing of it."""


def viewed(
    model: ModelLike,
    log: str | Path | None = None,
    state: StateLike = None,
    duration: float | None = None,
    step: float | None = None,
    solver: str | None = None,
    mapping: MappingLike = None,
) -> tuple[Mechanism, Trajectory, Ledger]:
    """A model, and its motion with its energies: as logged, else simulated from the model's start.

    Models that say nothing of their motion move from their start, or from zero and at rest, for 5 s.

    Args:
        model: what every verb takes.
        log: of its motion.
        state: where the motion starts.
        duration: s.
        step: step (s). [default: the problem's, else 0.001]
        solver: name of the solver. [default: the problem's, else ode5]
        mapping: of the log's columns, as for `audit`.

    Raises:
        InputError: as `load_model`, `simulate` and `audit`.
    """
    loaded = load_model(model)
    mechanism, problem = loaded.mechanism, loaded.problem
    if log is not None:
        read = read_log(mechanism, log, None, mapping)
        return mechanism, read.run, read.ledger
    start = loaded.start(state) if state is not None or loaded.starts else mechanism.state()
    if step is None:
        step = problem.step if problem else VIEW_STEP
    step = positive(step, "step")
    solver = solver or (problem.solver if problem else VIEW_SOLVER)
    seconds = duration
    if seconds is None:
        seconds = problem.duration if problem else DURATION
        seconds = step * max(2, round(min(seconds / step, LONG_LOG)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the page says where it stopped
        run = before_blow_up(simulate(mechanism, start, seconds, step, solver))
    return mechanism, run, balance(mechanism, run)


def motion_page(mechanism: Mechanism, run: Trajectory, ledger: Ledger, about: str = "") -> Page:
    """The page of a motion: the mechanism, its energies, its coordinates."""
    facts = [
        ("time", f"{run.t[0]:g} to {run.t[-1]:g} s"),
        ("rows", f"{len(run):,}"),
        ("energy exchanged", number(ledger.energy_exchanged, "J")),
    ]
    stopped = "" if run.provenance.completed else f"It stopped early: {run.provenance.message}."
    energies, *others = energy_plots(ledger)
    return Page(
        title=mechanism.name,
        asked=about or "The motion and its energies. Nothing was judged.",
        tone="plain" if not stopped else "doubt",
        word=mechanism.name[:1].upper() + mechanism.name[1:],
        sentence=stopped,
        numbers=tuple(facts),
        chapters=(
            Chapter("Motion and energies", (replace(energies, tall=True),)),
            Chapter("The motion", tuple(motions(run, mechanism))),
            Chapter("Where the energy went", tuple(others)),
        ),
        scene=moving(mechanism, [("run", run)]),
        made=made(run, mechanism),
        data=ledger.to_dict(),
    )


def log_page(path: Path, mapping: MappingLike = None) -> Page:
    """The page of a log whose model is not known: its curves.

    Raises InputError for a log that cannot be read.
    """
    run = read_trajectory(path, mapping)
    forces = [
        (str(channel), np.linalg.norm(values, axis=1)) for channel, values in run.forces.items()
    ]
    return Page(
        title=path.name,
        asked="The curves of a log. With its model the mechanism moves: deltac view MODEL LOG.",
        tone="plain",
        word=path.name,
        sentence="" if run.provenance.completed else f"It stopped early: {run.provenance.message}.",
        numbers=(
            ("time", f"{run.t[0]:g} to {run.t[-1]:g} s"),
            ("rows", f"{len(run):,}"),
            ("coordinates", str(len(run.coordinates))),
            ("channels", str(len(run.forces))),
        ),
        chapters=(
            Chapter(
                "The curves",
                tuple(
                    by_name(title, run.t, columns)
                    for title, columns in (
                        ("Coordinates", list(zip(run.coordinates, run.q.T))),
                        ("Speeds", list(zip(run.speeds, run.u.T))),
                        ("Sizes of the generalized forces", forces),
                    )
                    if columns
                ),
            ),
        ),
        made=made(run),
        data={"log": path.name},
    )
