"""Programs as people write them are read, and are the equations of their models."""

from __future__ import annotations

import pytest
from equations import cold
from equations.cold.mistakes import MISTAKES as COLD_MISTAKES
from equations.wild import CASES, Case
from equations.wild.mistakes import MISTAKES

from deltac.diagnosis.inputs.equations import load_equations
from deltac.repair.repair import repair_source
from deltac.repair.tracing.program import read
from deltac.repair.tracing.samples import RIGHT, Target
from deltac.repair.tracing.source import read_source

pytestmark = pytest.mark.case_study("test_every_style_is_read")

BRIEF = ("hopper_branch", "quadrotor_scalar", "rigid_body_quaternion", "masses_loop", "slip_class")


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(c, marks=[] if c.name in BRIEF else [pytest.mark.slow], id=c.name)
        for c in CASES
    ],
)
def test_every_style_is_read(case: Case) -> None:
    """Read at other parameters too, where the program names them; and run by Python it gives the same."""
    target = Target(*case.load())
    found = read(read_source(case.target), target)
    assert found.wrong < RIGHT
    assert callable(load_equations(case.target))


@pytest.mark.parametrize("name", ["hopper_branch", "masses_loop", "rigid_body_quaternion"])
def test_mistakes_in_branches_loops_and_rates_are_repaired(name: str) -> None:
    """The first mistake by hand of each: a branch, a loop's turns, q̇ of a callable object."""
    case = next(c for c in CASES if c.name == name)
    source = read_source(case.target)
    words, old, new = MISTAKES[name][0]
    found = repair_source(source.replaced(source.text.replace(old, new, 1)), Target(*case.load()))
    assert found.fixes and found.fixes[0].ran, words


@pytest.mark.parametrize(
    ("name", "which", "kind"),
    [
        pytest.param(
            "knife_edge_lstsq", 2, "factor", id="an entry of the speeds that nothing else uses"
        ),
        pytest.param(
            "walker_namedtuple",
            0,
            "term",
            id="a term of a property that is asked for thrice",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "pulleys_attrs",
            0,
            "term",
            id="J / r**2 of an object within an object",
            marks=pytest.mark.slow,
        ),
        pytest.param("aircraft_body_axes", 0, "order", id="a matrix that is not transposed"),
    ],
)
def test_what_programs_written_cold_lacked(name: str, which: int, kind: str) -> None:
    """Styles and edits that no other program of the benches needs; Python has run each."""
    case = next(c for c in cold.CASES if c.name == name)
    source = read_source(case.target)
    words, old, new = COLD_MISTAKES[name][which]
    found = repair_source(source.replaced(source.text.replace(old, new, 1)), Target(*case.load()))
    assert found.fixes and found.fixes[0].kinds == (kind,) and found.fixes[0].ran, words
