"""Two mistakes in equations that are solved for u̇ by hand: in the mass matrix, in the forces, in both."""

from __future__ import annotations

from pathlib import Path

import equations
import numpy as np
import pytest

from deltac.diagnosis.check.location import blame
from deltac.repair.edits.unsolved_form import unsolved_form
from deltac.repair.outcome import Repair, blamed_terms
from deltac.repair.repair import repair_source
from deltac.repair.tracing.program import read
from deltac.repair.tracing.samples import RIGHT, Target
from deltac.repair.tracing.source import Source

ARM = Path(equations.__file__).with_name("two_link_arm.py").read_text(encoding="utf-8")
ELBOW = ("- c1 * va + elbow", "- c1 * va - elbow")
BOTH = {
    "an inertia, a sign in the other row": [("l2**2 / 3", "l2**2 / 12"), ELBOW],
    "an inertia and a sign in one row": [("m1 / 3 + m2", "m1 / 2 + m2"), ELBOW],
    "a coupling, in both rows, and a sign": [("np.cos(a - b)", "np.cos(a + b)"), ELBOW],
    "an inertia, and a damper forgotten": [("l2**2 / 3", "l2**2 / 12"), (" + c2 * (vb - va)", "")],
}


@pytest.fixture(scope="module")
def target() -> Target:
    """Two rods with dampers and a spring at the elbow, in absolute angles."""
    return Target(*equations.load("two_link_arm"))


def mistaken(edits: list[tuple[str, str]], text: str = ARM) -> str:
    for old, new in edits:
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text


def accelerations(text: str) -> np.ndarray:
    """What Python makes of a text at one state, its constants moved."""
    namespace: dict[str, object] = {}
    exec(text, namespace)
    namespace.update(m1=1.1, m2=0.83, l1=0.77, l2=0.52, g=8.3, c1=0.2, c2=0.3, k=1.7)
    return np.array(namespace["rhs"](0.0, np.array([0.4, -1.1]), np.array([0.7, 1.9])))  # type: ignore[operator]


@pytest.mark.slow
@pytest.mark.parametrize("name", BOTH)
def test_the_mass_matrix_and_a_force(name: str, target: Target) -> None:
    found = repair_source(Source("eom.py", mistaken(BOTH[name]), "rhs"), target)
    assert found.fixes and len(found.fixes[0].lines) == 2, found.explain()
    # 1e-10: the same formula, whose matrix is well conditioned
    np.testing.assert_allclose(accelerations(found.fixes[0].text), accelerations(ARM), rtol=1e-10)


def test_mistakes_stay_in_their_rows(target: Target) -> None:
    """A wrong inertia of the lower rod, and a wrong force on the upper: each in one row of M u̇ − f."""
    for edit, wrong in (
        (BOTH["an inertia and a sign in one row"][:1], 0),
        ([("b) - elbow", "b)")], 1),
    ):
        program = read(Source("eom.py", mistaken(edit), "rhs"), target).worst
        rows = unsolved_form(program)
        assert rows is not None
        off = np.abs(rows.original_residual).max(axis=1)
        assert off[wrong] > 1e-3 and off[1 - wrong] < RIGHT
        plain = np.abs(program.run() - program.samples.acceleration).max(axis=1)
        assert (plain > 1e-3).all()  # where both accelerations are wrong


def test_a_function_of_which_nothing_is_evaluated_once(target: Target) -> None:
    """No expression has one value that it must have; the search ends without an edit."""
    text = "def rhs(t, q, u):\n    return [x * x for x in q]\n"
    found = repair_source(Source("eom.py", text, "rhs"), target)
    assert not found.right and not found.fixes and found.complete


def test_terms_that_are_known_are_said_where_no_edit_is_found(target: Target) -> None:
    """Three mistakes: the equations are the model's but for factors, so nobody asks whose they are."""
    edits = [
        ("l2**2 / 3", "l2**2 / 12"),
        ("m1 / 3 + m2", "m1 / 12 + m2"),
        ("m1 / 2 + m2", "m1 + m2"),
    ]
    test = target.test()
    program = read(Source("eom.py", mistaken(edits), "rhs"), target).worst
    udot = program.run()[:, program.samples.group == 0]
    terms = sorted(blamed_terms(blame(test, udot, np.full(2, RIGHT))))
    assert len(terms) == 2
    assert terms[1].startswith("equation 2 (b)") and "the inertia term" in terms[1]
    assert "0.25" in terms[1]  # (1/12) / (1/3)
    repair = Repair("eom.py", "rhs", program.wrong, ("a", "b"), terms=tuple(terms))
    text = " ".join(repair.explain().split())
    assert terms[1] in text and "Is it the function" not in text


@pytest.mark.slow
def test_two_mistakes_beside_multipliers_raise_nothing() -> None:
    """Equations solved together with a multiplier: a solution of them is no number of the tape."""
    from equations.wild import CASES

    case = next(c for c in CASES if c.name == "segway_kkt")
    text = Path(f"{case.target.partition(':')[0]}").read_text("utf-8")
    wrong = mistaken(
        [("om**2 * np.sin(th)", "om**2 * np.cos(th)"), ("[mw + mb, 0.0", "[mw, 0.0")], text
    )
    found = repair_source(Source("eom.py", wrong, "segway"), Target(*case.load()))
    assert not found.right
