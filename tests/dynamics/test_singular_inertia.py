"""Mass matrices that are singular are refused by name at every door, those that are merely small are not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.dynamics.singular_inertia import without_inertia


def slender(along: Any, looped: bool) -> dc.Mechanism:
    """A slender rod on a free joint, perhaps pinned: nothing resists a turn about its own axis."""
    pin = dc.constraints.loop_spherical("pin", "ground", "bar")
    return dc.Mechanism(
        [dc.bodies.rod("bar", 2.0, 1.0, along)],
        [dc.joints.free("float", "bar")],
        constraints=[pin] if looped else [],
    )


DOORS: dict[str, Callable[[dc.Mechanism], Any]] = {
    "evaluate": lambda m: dc.evaluate(m, m.state({})),
    "simulate": lambda m: dc.simulate(m, m.state({}), 0.1, 0.01),
    "check": lambda m: dc.check_equations(m, lambda t, q, u: 0 * u),
    "classify": lambda m: dc.classify(m),
}


@pytest.mark.parametrize("looped", [True, False])
@pytest.mark.parametrize(("along", "speeds"), [("x", 1), ((1, 2, 3), 3)])  # exact, and to rounding
@pytest.mark.parametrize("door", DOORS)
def test_a_slender_rod_that_may_turn_about_itself(
    door: str, along: Any, speeds: int, looped: bool
) -> None:
    with pytest.raises(dc.InputError) as refused:
        DOORS[door](slender(along, looped))
    said = str(refused.value)
    assert refused.value.code == "E-MODEL" and "'bar'" in said
    assert [f"'float.w{axis}'" in said for axis in "xyz"] == [True, *[speeds == 3] * 2]


def test_assembly_names_it_too() -> None:
    m = slender("x", True)
    with pytest.raises(dc.InputError, match=r"float\.wx"):
        dc.assemble(m, m.state({}))


def test_units_and_small_inertias_are_no_singularity() -> None:
    """Scaling a speed scales its row and column: the null motion (1, −1) is found in any units."""
    regular = np.array([[2.0, 1.0], [1.0, 2.0]])
    flat = np.array([[1.0, 1.0], [1.0, 1.0]])
    for scale in (1e-9, 1.0, 1e9):
        D = np.diag([scale, 1.0])
        assert not without_inertia(D @ regular @ D).size
        assert without_inertia(D @ flat @ D).tolist() == [0, 1]
