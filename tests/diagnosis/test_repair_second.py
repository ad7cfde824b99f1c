"""What a first edit leaves, sums of two terms, edits within edits; and code whose names are set elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from equations.wild import CASES
from equations.wild.mistakes import MISTAKES

import deltac as dc
from deltac.diagnosis.inputs.equations import load_equations
from deltac.errors import SourceError
from deltac.repair.edits.candidates import EditCandidate, apply
from deltac.repair.edits.insertions import sums
from deltac.repair.edits.search import EditSearch, _explained
from deltac.repair.repair import repair_source
from deltac.repair.tracing.program import read
from deltac.repair.tracing.samples import RIGHT, Target
from deltac.repair.tracing.source import Source, read_source

BOB = dc.Mechanism(
    [dc.point_mass("bob", "m", at=(0, "-l", 0))],
    [dc.revolute("a", "ground", "bob", damping="c")],
    gravity=(0, "-g", 0),
    parameters={"m": 1.3, "l": 0.7, "g": 9.81, "c": 0.2},
)

STYLES = {
    "a generator": """
from math import sin
m, l, g, c = 1.3, 0.7, 9.81, 0.2
def torques(q, u):
    yield -m * g * l * sin(q[0])
    yield from (-c * v for v in u)
def rhs(t, q, u):
    return [sum(torques(q, u)) / (m * l**2)]
""",
    "a text of JSON": """
import json
from math import sin
P = json.loads('{"m": 1.3, "l": 0.7, "g": 9.81, "damper": {"c": 0.2}}')
def rhs(t, q, u):
    return [-P["g"] / P["l"] * sin(q[0]) - P["damper"]["c"] / (P["m"] * P["l"]**2) * u[0]]
""",
    "a partial function with names": """
from functools import partial
from math import sin
def f(t, y, p, c):
    return [y[1], -p["g"] / p["l"] * sin(y[0]) - c / (p["m"] * p["l"]**2) * y[1]]
rhs = partial(f, p={"m": 1.3, "l": 0.7, "g": 9.81}, c=0.2)
""",
}


@pytest.mark.parametrize("style", STYLES)
def test_styles_are_read_with_all_their_constants(style: str) -> None:
    found = read(Source("eom.py", STYLES[style], "rhs"), Target(BOB))
    assert found.wrong < RIGHT
    assert found.varied == ("c", "g", "l", "m")


def test_a_function_within_a_running_one_is_refused_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "eom.py"
    file.write_text("def simulate(T=1.0):\n    def rhs(t, y):\n        return y\n    return 0.0\n")
    with pytest.raises(SourceError, match=r"rhs \(line 2\) is defined within simulate"):
        load_equations(f"{file}:simulate.rhs")


CAR = """
import numpy as np
m, J, d = 12.0, 0.8, 3.0
def rhs(t, q, u):
    c, s = np.cos(q[2]), np.sin(q[2])
    along, across = c * u[0] + s * u[1], -s * u[0] + c * u[1]
    F, G = -d * along, -2.5 * d * across
    return [(c * F - s * G) / m, (s * F + c * G) / m, 0.0]
"""


def test_a_sum_of_two_terms_is_put_in_the_place_of_a_name() -> None:
    """Body axes for world axes: F for c F − s G."""
    along = "(cos(q.p)*u.x + sin(q.p)*u.y)"
    across = "(-sin(q.p)*u.x + cos(q.p)*u.y)"
    car = dc.Mechanism(
        [dc.bodies.frame("sx"), dc.bodies.frame("sy"), dc.body("car", "m", (0.5, 0.6, "J"))],
        [
            dc.prismatic("x", "ground", "sx"),
            dc.prismatic("y", "sx", "sy", "y"),
            dc.revolute("p", "sy", "car"),
        ],
        [
            dc.forces.point_force(
                "drag", "car", (f"-d*{along}", f"-2.5*d*{across}", 0), frame="body"
            )
        ],
        parameters={"m": 12.0, "J": 0.8, "d": 3.0},
    )
    target = Target(car)
    assert read(Source("eom.py", CAR, "rhs"), target).wrong < RIGHT
    wrong = Source("eom.py", CAR.replace("(c * F - s * G) / m", "F / m"), "rhs")
    search = EditSearch(read(wrong, target).worst, target)
    search.require()
    texts = [c.text for r in search.sufficient for c in sums(search.program, r, search.vocabulary)]
    assert "c * F - s * G" in texts


def test_an_edit_within_an_edit() -> None:
    source = Source("eom.py", "def rhs(t, q, u):\n    return a * (b + c)\n", "rhs")

    def edit(old: str, new: str) -> EditCandidate:
        place = next(
            k
            for k, n in enumerate(source.nodes)
            if hasattr(n, "lineno") and source.segment(n) == old
        )
        return EditCandidate(source, place, new, "term", 1.0)

    changed = apply(source, [edit("b", "b**2"), edit("b + c", "b - c")])
    assert changed is not None and "a * ((b**2) - c)" in changed.text


def test_a_residual_along_one_expression_is_explained_by_it() -> None:
    rng = np.random.default_rng(0)
    along = rng.standard_normal((3, 2, 12))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    left = along[1] * rng.standard_normal(12)  # of another size at each state
    assert list(_explained(along, left)) == [False, True, False]


def test_an_inertia_without_mass_does_not_slow_the_samples_down() -> None:
    """A disc given by its moment alone: its radius of gyration is no length of the mechanism."""
    made = dc.Mechanism(
        [
            dc.body("disc", 1e-12, (0.03, 0.03, 0.06)),
            dc.point_mass("bob", 1.0, at=(0, -0.5, 0)),
        ],
        [dc.revolute("spin", "ground", "disc"), dc.revolute("a", "ground", "bob")],
        gravity=(0, -9.81, 0),
    )
    speeds = np.abs(dc.random_states(made, count=32).u).max(axis=1)
    assert speeds.min() > 0.1  # √(g/l) is some rad/s; it was 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("acrobot_closure", ("the wrong sine", "a symmetric entry")),
        ("crane_namespace", ("a damper's reaction", "a length")),
    ],
)
def test_pairs_of_which_neither_rights_an_equation(name: str, words: tuple[str, ...]) -> None:
    case = next(c for c in CASES if c.name == name)
    source = read_source(case.target)
    for wanted in words:
        old, new = next((o, n) for w, o, n in MISTAKES[name] if w == wanted)
        source = source.replaced(source.text.replace(old, new, 1))
    found = repair_source(source, Target(*case.load()), 200.0)
    assert found.fixes, found.explain()


def test_an_index_out_of_range_is_told_with_its_line() -> None:
    text = """
from math import sin
m, l, g, c = 1.3, 0.7, 9.81, 0.2
def rhs(t, y):
    a, w = y[1], y[2]
    return [w, -g / l * sin(a) - c / (m * l**2) * w]
"""
    with pytest.raises(SourceError, match=r"eom.py:5: IndexError"):
        repair_source(Source("eom.py", text, "rhs"), Target(BOB))


def test_an_index_out_of_range_is_none_of_a_control() -> None:
    """Read as f(t, y, control), with two controls of zero, the function would run."""
    text = """
from math import sin
m, l, g, c = 1.3, 0.7, 9.81, 0.2
def rhs(t, q, u):
    return [-g / l * sin(q[0]) - c / (m * l**2) * u[1]]
"""
    found = repair_source(Source("eom.py", text, "rhs"), Target(BOB))
    assert found.fixes[0].words == ("u[1] should be u[0]",) and found.fixes[0].ran


def test_a_term_is_missing_beside_a_control_that_is_zero() -> None:
    text = """
from math import sin
m, l, g, c = 1.3, 0.7, 9.81, 0.2
def rhs(state, force):
    a, w = state
    x = l * sin(a)
    moment = force * l
    return [w, moment / (m * l**2)]
"""
    found = repair_source(Source("eom.py", text, "rhs"), Target(BOB))
    assert found.fixes and found.fixes[0].lines == (7,) and found.certain


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("chain_loops", "u[j] ** 2", "u[i] ** 2", "u[i] should be u[j]"),
        ("masses_loop", "v[i - 1] if", "v[i] if", "v[i] should be v[i - 1]"),
        ("kapitza_solve_ivp", "c / (m * l**2)", "c", "c * omega must be divided by m and l**2"),
        # The term's weight is ω²: where ω is small, rounding decides what the sine must be.
        ("segway_kkt", "om**2 * np.sin", "om**2 * np.cos", "np.cos(th): cos should be sin"),
        ("segway_kkt", "mb * l * om**2", "om**2", "om**2 * np.sin(th) lacks the factor mb * l"),
        ("masses_matrices", "-np.linalg.inv(M) @ C", "-C", "C lacks the factor np.linalg.inv(M)"),
        ("masses_matrices", "[-np.linalg.inv(M) @", "[-M @", "M should be inverted"),
        ("masses_loop", "F / m", "F - m", "F - m: - should be /"),
        ("cartpole_matrix", "-C @ qd - G", "-G", "G lacks the term + C @ qd"),
    ],
)
def test_what_one_expression_should_be(name: str, old: str, new: str, words: str) -> None:
    case = next(c for c in CASES if c.name == name)
    source = read_source(case.target)
    text = source.text.replace(old, new, 1)
    assert text != source.text
    found = repair_source(source.replaced(text), Target(*case.load()))
    assert found.fixes[0].words == (words,) and found.fixes[0].ran and found.certain


def test_an_unused_constant_of_another_module_is_known(tmp_path: Path) -> None:
    """The only use of prm.g was mistaken: its module still has it."""
    (tmp_path / "prm.py").write_text("m, l, g, c = 1.3, 0.7, 9.81, 0.2\n")
    file = tmp_path / "eom.py"
    file.write_text(
        "import prm\nfrom math import sin\ndef rhs(t, q, u):\n"
        "    return [-prm.m / prm.l * sin(q[0]) - prm.c / (prm.m * prm.l**2) * u[0]]\n"
    )
    found = repair_source(read_source(f"{file}:rhs"), Target(BOB))
    assert "-prm.g / prm.l" in found.fixes[0].text and found.certain


def test_an_array_never_holds_itself(tmp_path: Path) -> None:
    """As NumPy, which cannot set an element to an array; arithmetic on such an array never ends."""
    file = tmp_path / "eq.py"
    file.write_text(
        "import numpy as np\n\ndef rhs(t, q, u):\n    F = np.zeros(1)\n"
        "    F[0] -= 3.0 * q[0]\n    F[0] -= np.zeros(2)\n    return F\n"
    )
    model = dc.Mechanism(
        [dc.point_mass("m", 1.0)], [dc.prismatic("x", "ground", "m", stiffness=3.0)]
    )
    with pytest.raises(dc.InputError, match="several numbers"):
        dc.repair_equations(model, f"{file}:rhs")
