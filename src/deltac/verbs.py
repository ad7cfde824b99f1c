"""The verbs whose cores take a Mechanism and a State: here they take whatever stands for one.

A core stands below the door (`deltac.models`), so that it cannot depend on files, problems or importers.
Verbs of packages above the door open it themselves. A verb loads its core when it is called: a simulation
needs no readers of files.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.expressions import Law
from deltac.models import ModelLike, StateLike, load_model
from deltac.simulation import simulate as simulation
from deltac.simulation.equations import Controller, Equations, RightHandSide
from deltac.simulation.flow import Keeping
from deltac.simulation.recording import RECORD, Record
from deltac.simulation.solvers import FixedStep, Options
from deltac.trajectories.columns import MechanismNames
from deltac.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from deltac.energy.ledger import Ledger
    from deltac.importers.sympy_equations import SymbolicEquations
    from deltac.simulation.constraints.assembly import Assembly
    from deltac.simulation.ensemble.ensemble import Ensemble
    from deltac.simulation.ensemble.members import States
    from deltac.simulation.step_size.time_scales import TimeScale
    from deltac.trajectories.formats.mapping import LogMapping
    from deltac.trajectories.formats.objects import LogSource


@checked
@interruptible()
def simulate(
    model: ModelLike,
    state: StateLike = None,
    duration: float | None = None,
    step: float | None = None,
    solver: str | Options = "ode5",
    record: Record | Sequence[str] | int = RECORD,
    equations: Equations | RightHandSide | None = None,
    *,
    controller: Controller | None = None,
    constraints: str | Keeping = "projection",
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a mechanism from a state, and integrate the powers of testing functions with it.

    Args:
        model: what moves: a Mechanism, a Problem, or what else `load_model` takes. The code that runs is
            compiled once for all values of the parameters named by `Mechanism.varying`.
        state: where it starts (`mechanism.state(...)`), or values by name; by default the model's own start.
        duration: how long, s; by default the problem's.
        step: of a fixed-step solver, s; it must divide the duration. For the others the spacing of
            samples; without it they are sampled at their own steps (Taylor, CVODES, IDAS: 200 samples).
        solver: a name or alias of `solver_names()`, or an object of `deltac.solvers` with options, such as
            `Scipy("DOP853", tolerance=1e-9)`.
        record: a `Record`; or just the names of the testing functions, or the number of steps between rows.
        equations: hand-written equations of motion in place of the mechanism's own: `Equations`, or a
            function (t, q, u) -> u̇ of the mechanism's coordinates, or (t, y) -> ẏ as SciPy takes it.
        controller: drives the motors that have no law (`joint_torque` without torque).
        constraints: how the run stays on its constraints: "projection" of q and u after each step (least
            in the mass metric), `Projection(energy=True)`, `Baumgarte(alpha, beta)`, or None.
        progress: called with the fraction done.

    Returns:
        Trajectory with q, u, u̇ of all joints, the forces (channels ``prescribed`` and ``actuator``) that
        drove it, and the integrals. A run whose state ceases to be finite, or whose implicit step has no
        solution, stops there with a warning `SimulationStoppedWarning`; the trajectory keeps the rows so far,
        and its provenance says when and why.

    Raises:
        InputError: the model or an argument cannot be simulated; raised before anything is computed.

    Warns:
        EnergyErrorWarning: by its own testing functions the run is off by more than a tenth of the energy
            that took part; it names a step that would do.
        EnergyLeftWarning: corrections of the energy could not keep up with what the steps lost.
        IllConditionedWarning: the accelerations at the start have few digits in double precision, since
            masses or lengths differ by too many powers of ten.
        StiffStepWarning: the step is far too large for friction, contact, or the mechanism; it names the time
            scale.
    """
    source = load_model(model)
    return simulation.simulate(
        source.mechanism,
        source.start(state),
        source.lasting(duration),
        step,
        solver,
        record,
        equations,
        controller=controller,
        constraints=constraints,
        progress=progress,
    )


@checked
@interruptible()
def simulate_ensemble(
    model: ModelLike,
    states: States | StateLike,
    duration: float | None,
    step: ArrayLike,
    solver: str | FixedStep | Sequence[str | FixedStep] = "ode5",
    record: Record | Sequence[str] | int = RECORD,
    *,
    vary: Mapping[str, ArrayLike] | None = None,
    sensitivity: Sequence[str] = (),
    threads: int | None = None,
    progress: Progress | None = None,
) -> Ensemble:
    """Simulate many members of a mechanism with fixed-step solvers.

    States, steps, solvers and parameters that differ between members have N entries; shared ones have one.

    Args:
        model: what moves, as for `simulate`.
        states: one for all members (None: the model's own start); a sequence of N, all at the same time; or
            (Q, U) of shapes (N, nq) and (N, nu), all joints, at t = 0.
        duration: how long, s; by default the problem's.
        step: of the solver, s, or (N,); it must divide the duration.
        solver: a fixed-step one, see `simulate`, or N of them.
        record: a `Record`; or just the names of the testing functions, or the number of steps between rows
            (the longest ones where steps differ). By default the start and the end are kept.
        vary: values (N,) of parameters by name, one for each member. Other values need no new compilation.
        sensitivity: parameters by which ΔC is differentiated: exact derivatives of the discrete motion,
            from a start that does not depend on them. Each adds about two steps' work to every step.
        threads: how many cores; all by default.
        progress: called with the fraction done, from any thread but never from two at once.

    Raises:
        InputError: as `simulate`. For sizes that do not fit the message names the array, and for members that
            violate a constraint or a prescribed motion at the start it names the first.
    """
    from deltac.simulation.ensemble import ensemble

    source = load_model(model)
    if states is None or isinstance(states, Mapping | str | Path):
        states = source.start(states)
    return ensemble.simulate_ensemble(
        source.mechanism,
        states,
        source.lasting(duration),
        step,
        solver,
        record,
        vary=vary,
        sensitivity=sensitivity,
        threads=threads,
        progress=progress,
    )


@checked
@interruptible()
def assemble(model: ModelLike, guess: StateLike = None, pinned: Collection[str] = ()) -> Assembly:
    """Find coordinates and speeds near a guess that satisfy every constraint.

    Args:
        model: with constraints: a Mechanism, a Problem, or what else `load_model` takes.
        guess: an approximate state, or values by name; its time is kept. By default the model's own start.
        pinned: names of coordinates and speeds that keep the values of the guess.

    Returns:
        The assembly. Its state is near the guess: it is found by damped Newton steps of least norm in the
        mass metric. Where these steps do not exist, because the mass matrix is singular at the guess (polar
        coordinates at radius zero) or a constraint is stationary there (a circle at its centre), they start
        from a perturbed guess, and coordinates that need not move keep the values of the guess.

    Raises:
        InputError: an unknown pinned name, or constraints that cannot be satisfied; the message names the
            worst constraint and its residual, and the speeds without inertia if the mass matrix is singular
            at the guess.
    """
    from deltac.simulation.constraints import assembly

    source = load_model(model)
    return assembly.assemble(source.mechanism, source.start(guess), pinned)


@checked
def time_scales(model: ModelLike, state: StateLike = None) -> tuple[TimeScale, ...]:
    """Time scales of a model's friction and contacts at a state, the shortest first.

    For a contact, the overlap is the largest of three: the present one, the one that carries the weight of
    its effective mass, and the one that stops the mass at its speed of approach after falling through the
    gap. These are estimates from the present state, not bounds on the motion.
    """
    from deltac.simulation.step_size import time_scales as scales

    source = load_model(model)
    return scales.time_scales(source.mechanism, source.start(state))


@checked
@interruptible()
def balance(
    model: ModelLike,
    run: Trajectory,
    work: str | None = None,
    testing: Sequence[str] | None = None,
    *,
    coordinates: CoordinateMap | str | None = None,
    potential: Law | str | None = None,
    keep: int | None = None,
) -> Ledger:
    """Evaluate the energy testing functions on a trajectory.

    Args:
        model: what the motion is tested against: a Mechanism, a Problem, or what else `load_model` takes.
        run: the motion. Forces that it holds are used in place of the model's own, and channels that the
            model does not have are added.
        work: how the power is integrated. "in-loop": by the integrals that the solver took, or by the
            works that a recorder took at the integrator's own stages; powers without a recorded work are
            integrated along the samples (the default where the run has either). "samples": by
            quadrature along the samples. "discrete": a force held over a step does the work
            h fᵀ(u_k + u_{k+1})/2, for engines of first order.
        testing: names of testing functions; by default those integrated in the loop, or all. "momentum"
            stands for the functions ΔP_r of all speeds, which are also taken by default; named alone, it is
            taken beside "wang".
        coordinates: own generalized speeds in which the kinetic energy is divided (Kane–Levinson) and whose
            momentum functions are taken: a CoordinateMap, "joint" or "absolute"; by default those in which
            the run's integrals were taken.
        potential: V(q, t) (J) in E of Wang's and Kane–Levinson's functions, a law or its text; its rate takes
            the place of V̇ in P. By default the model's potential energy, which the ledger reports in any
            case. Any function will do (Kane and Levinson's choice of V and G_r): it decides which forces are
            compared by a difference of V and which are integrated. Its range is part of the energy exchanged.
            Along samples only.
        keep: about how many rows the ledger is to have, one in 512 of the run at least: of equal
            parts of the run those where |ΔC| is largest, the first and the last, extremes of K and V.
            Works, ΔC, bars and the energy exchanged are taken over all rows, and violations are the largest
            since the row before. A long log of equidistant samples takes a fraction of the time and of the
            memory so. By default all rows.

    Returns:
        The ledger. Works of channels are those that the solver integrated, where `work` is "in-loop" and
        the run has them, else they are taken along the samples; each has an error bar.

    Raises:
        InputError: the run is not one of this mechanism, has too few samples, lacks a motor's force, or
            lacks the integrals asked for.
    """
    from deltac import energy

    source = load_model(model)
    own = None if coordinates is None else source.coordinate_map(coordinates)
    return energy.balance(
        source.mechanism, run, work, testing, coordinates=own, potential=potential, keep=keep
    )


@checked
def residuals(
    model: ModelLike,
    run: Trajectory,
    testing: Sequence[str] | None = None,
    *,
    coordinates: CoordinateMap | str | None = None,
) -> dict[str, Array]:
    """The testing functions in rate form, ε = Ė − P (W), at every sample, without any integration.

    Returns ε (T,) by the function's name, and under ``"coordinates"`` the residual F_r + F*_r (T, n) of
    Kane's equations for the free speeds (N·m or N), less what constraint forces explain. Under ``"momentum"``
    is the rate form of ΔP_r (T, n), ṗ_r − F_r − (Gᵀλ)_r − ṡ_r·H_r, of the free or the own speeds; λ is that
    of the log, or of the model's equations at the state. Needs the run's accelerations.

    Raises InputError as `balance`, and for a run without u̇.
    """
    from deltac import energy

    source = load_model(model)
    own = None if coordinates is None else source.coordinate_map(coordinates)
    return energy.residuals(source.mechanism, run, testing, coordinates=own)


@checked
def symbolic_equations(model: ModelLike, *, simplify: bool = True) -> SymbolicEquations:
    """Write a model's equations of motion out in its coordinates, speeds and parameters.

    They are the recursions that the kernels run, translated to SymPy, so that what you read is what is
    computed. `simplify` expands them and gathers sines and cosines, which takes seconds from 3 speeds on.

    Raises InputError for a model of more free speeds than fit on a page.
    """
    from deltac.importers import sympy_equations

    return sympy_equations.symbolic_equations(load_model(model).mechanism, simplify=simplify)


@checked
def read_trajectory(
    log: LogSource, mapping: LogMapping | ModelLike | None = None, model: ModelLike | None = None
) -> Trajectory:
    """Read a log of deltac or of another program, in the format of its suffix.

    Args:
        log: the path of a file, or a table itself: a dictionary of arrays, a DataFrame of pandas or polars,
            an xarray Dataset, an array (T, n).
        mapping: which columns are what, in which units: a TOML file, or a `LogMapping`. Anything else in
            this place is the model: ``read_trajectory("run.npz", "robot.xml")``.
        model: what moved: a Mechanism, a Problem, or what else `load_model` takes. It says which coordinates
            are needed and which are angles; without it, and without a mapping, the columns have the names of
            the log schema.

    Returns:
        The trajectory. ``provenance.reading`` says in one line how each column was read, and why;
        ``provenance.guessed`` which readings rest on the motion alone. A log without any speeds gets them
        from splines; ``provenance.derived`` says so.

    Raises:
        InputError: that names the file and, where it applies, column and row.
    """
    from deltac.trajectories.formats import files
    from deltac.trajectories.formats.mapping import LogMapping

    columns: Any = mapping
    path = isinstance(mapping, str | Path) and Path(mapping).suffix.lower() == ".toml"
    if model is None and not (mapping is None or path or isinstance(mapping, LogMapping)):
        columns, model = None, mapping
    names = model if isinstance(model, MechanismNames | None) else load_model(model).mechanism
    return files.read_trajectory(log, columns, names)
