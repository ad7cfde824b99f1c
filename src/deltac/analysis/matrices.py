"""`matrices`: the theory's matrices of a model at a state, or along a run."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from deltac.analysis.model import instants, motors
from deltac.calls.arguments import checked
from deltac.dynamics.matrices import Matrices, matrices_at, stacked
from deltac.models import ModelLike, StateLike
from deltac.trajectories import Trajectory


@checked
def matrices(
    model: ModelLike,
    state: StateLike | Trajectory = None,
    *,
    inputs: Mapping[str, Any] | None = None,
    independent: Collection[str] = (),
    joints: bool = False,
) -> Matrices:
    """The matrices of the energy theorem: R, v_t, J, A, R̂, M, β, F, F*, F′, λ, joint reactions.

    Written for reading, in dense NumPy, and independent of the code that simulates: milliseconds a body and
    sample. `evaluate` is the fast way to M, the bias and λ.

    Args:
        model: a Mechanism, a Problem, a problem's name, a model file or ``file.py:callable``.
        state: a State; or a Trajectory, whose samples then are the first axis of every array. By default the
            problem's start.
        inputs: values (N·m or N) of the motors without a law, by name; zero where not given. A run has its
            own.
        independent: names of the speeds u that the others follow from; by default those in which the others
            are best expressed, chosen at the first sample.
        joints: also write the tree's joints as constraints, `J_joints`.

    Returns:
        `Matrices`. F* is that of the run's own accelerations where it has them, else of the equations of
        motion.

    Raises:
        InputError: a state that does not fit the model, unknown names, dependent `independent` speeds.
    """
    at = instants(model, state, inputs)
    names = tuple(independent)
    samples: list[Matrices] = []
    for k in range(len(at.t)):
        samples.append(
            matrices_at(
                at.mechanism,
                float(at.t[k]),
                at.q[k],
                at.u[k],
                udot=None if at.udot is None else at.udot[k],
                inputs=motors(at.mechanism, at.inputs[min(k, len(at.inputs) - 1)]),
                independent=names,
                joints=joints,
            )
        )
        if not names:
            names = samples[0].speeds_hat
    return samples[0] if at.single else stacked(samples)
