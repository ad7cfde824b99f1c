"""Cases of the verdict's bench: motions by right and by wrong equations, drawn by a seed.

A case makes the runs of one motion at three steps, as some simulator would deliver them, and the model
they are to be judged against. Whether the equations are right is known beforehand, or found by comparing
accelerations at random states: never by what is to be tested.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from verdict_mujoco import mujoco_right, mujoco_wrong
from verdict_right import by_hand, right, traps
from verdict_runs import Case
from verdict_wrong import gyroscopic, lost_forces, mutated, parameters


def all_cases(seed: int, scale: float = 1.0) -> Sequence[tuple[str, Callable[[], Iterator[Case]]]]:
    """The generators of a seed, right ones first; `scale` shrinks the drawn ones for a quick look."""
    return (
        ("right: library", lambda: right(seed, round(240 * scale))),
        ("right: by hand", lambda: by_hand(seed)),
        ("right: traps", lambda: traps(seed)),
        ("right: MuJoCo", lambda: mujoco_right(seed)),
        ("wrong: single mistake", lambda: mutated(seed, round(42 * scale))),
        ("wrong: gyroscopic term", lambda: gyroscopic(seed)),
        ("wrong: parameter 1 %", lambda: parameters(seed, round(60 * scale))),
        ("wrong: lost force", lambda: lost_forces(seed)),
        ("wrong: MuJoCo", lambda: mujoco_wrong(seed)),
    )
