"""Equations in the forms that people give them: f(t, y) of any order, with a control, tables, libraries."""

from __future__ import annotations

import csv
import shutil
import subprocess
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.inputs.equations import load_equations

M, L, G = 1.3, 0.6, 9.81


@pytest.fixture(scope="module")
def crane() -> dc.Mechanism:
    """A trolley of mass 2 with a hanging particle."""
    return dc.Mechanism(
        [dc.point_mass("trolley", 2.0), dc.point_mass("load", "m", at=(0, "-l", 0))],
        [dc.prismatic("x", "ground", "trolley"), dc.revolute("a", "trolley", "load")],
        gravity=(0, "-g", 0),
        parameters={"m": M, "l": L, "g": G},
    )


def accelerations(a: float, va: float) -> tuple[float, float]:
    """Newton's second law for both, eliminated by hand."""
    s, c = sin(a), cos(a)
    xdd = M * s * (L * va**2 + G * c) / (2.0 + M * s**2)
    return xdd, -(xdd * c + G * s) / L


def plain(t: Any, q: Any, u: Any) -> Any:
    return accelerations(q[1], u[1])


def in_order(t: Any, y: Any) -> Any:
    return [y[2], y[3], *accelerations(y[1], y[3])]


def interleaved(y: Any, t: Any) -> Any:
    xdd, add = accelerations(y[2], y[3])
    return np.array([y[1], xdd, y[3], add])


def speeds_first(t: Any, y: Any) -> Any:
    return [*accelerations(y[3], y[1]), y[0], y[1]]


def driven(x: Any, force: Any) -> Any:
    return np.array([x[2], x[3], *accelerations(x[1], x[3])]) + 0.0 * force


def of_columns(x: Any, force: Any) -> Any:
    return np.array([x[2], x[3], *[[a] for a in accelerations(x[1, 0], x[3, 0])]]) + 0.0 * force


def angle_first(t: Any, y: Any) -> Any:
    xdd, add = accelerations(y[0], y[2])
    return [y[2], y[3], add, xdd]


def in_pairs(t: Any, q: Any, u: Any) -> Any:
    return u, np.array(accelerations(q[1], u[1]))


@pytest.mark.parametrize(
    ("function", "arguments", "order"),
    [
        (plain, ("t", "q", "u"), ()),
        (in_order, ("t", "state"), (0, 1, 2, 3)),
        (interleaved, ("state", "t"), (0, 2, 1, 3)),
        (speeds_first, ("t", "state"), (2, 3, 0, 1)),
        (driven, ("state", "control"), (0, 1, 2, 3)),
        (of_columns, ("state", "control"), (0, 1, 2, 3)),
        (angle_first, ("t", "state"), (1, 0, 3, 2)),
        (in_pairs, ("t", "q", "u"), ()),
    ],
)
def test_the_form_is_found_out(
    function: Any, arguments: tuple[str, ...], order: tuple[int, ...], crane: dc.Mechanism
) -> None:
    found = dc.check_equations(crane, function, count=12)
    assert found.verdict.kind == "consistent"
    assert (found.form.arguments, found.form.order) == (arguments, order)
    assert set(found.rates) == (set() if function is plain else {"x", "a"})


def test_a_wrong_rate_of_a_coordinate_is_an_error(crane: dc.Mechanism) -> None:
    """The accelerations are right; q̇ of the angle is not its speed."""

    def wrong(t: Any, y: Any) -> Any:
        return [y[2], 2 * y[3], *accelerations(y[1], y[3])]

    found = dc.check_equations(crane, wrong, count=12)
    assert found.verdict.kind == "equation-error" and not found.blame
    assert found.rates["a"] > 0.1 and found.rates["x"] < 1e-12
    assert [s.sees for s in found.seen if s.test == "coordinate rates"] == [True]


def test_exchanged_masses_are_no_order_of_coordinates() -> None:
    """Two like carts: with each other's mass, the function would be right in the other order."""
    masses = {"a": 1.0, "b": 2.0}
    carts = dc.Mechanism(
        [dc.body(name, m, inertia=(0.1, 0.1, 0.1)) for name, m in masses.items()],
        [dc.prismatic(f"x{name}", "ground", name, "x") for name in masses],
        forces=[dc.forces.joint_spring(f"k{name}", f"x{name}", 5.0) for name in masses],
    )
    found = dc.check_equations(
        carts, lambda t, y: [y[2], y[3], -5.0 * y[0] / 2.0, -5.0 * y[1] / 1.0]
    )
    assert found.verdict.kind == "equation-error"


def hamilton(t: Any, y: Any, weight: float = 1.0) -> Any:
    """Of H = (m L² p² − 2 m L c p r + (2 + m) r²)/2D − m g L c, with D = m L² (2 + m s²), by hand."""
    _, a, p, r = y
    s, c = sin(a), cos(a)
    D = M * L**2 * (2.0 + M * s**2)
    xd = (M * L**2 * p - M * L * c * r) / D
    ad = ((2.0 + M) * r - M * L * c * p) / D
    return [xd, ad, 0.0, -M * L * s * xd * ad - weight * M * G * L * s]


def test_hamiltons_equations_are_equations(crane: dc.Mechanism) -> None:
    found = dc.check_equations(crane, hamilton, count=12)
    assert found.verdict.kind == "consistent"
    assert found.form.momenta
    assert found.worst < 1e-11  # of differences of order eight
    wrong = dc.check_equations(crane, lambda t, y: hamilton(t, y, 1.1), count=12)
    assert wrong.verdict.kind == "equation-error"
    assert [b.speed for b in wrong.blame] == ["a"]
    assert dc.repair_equations(crane, "test.py:hamilton", function=hamilton).right
    repair = dc.repair_equations(
        crane, "test.py:hamilton", function=lambda t, y: hamilton(t, y, 1.1)
    )
    assert repair.equations == ("a",) and not repair.fixes
    assert "gravity" in repair.terms[0]


def filled(path: Path, factor: float, digits: int) -> None:
    """What a program in another language does: read the table, write accelerations."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        values = accelerations(float(row["q.a"]), float(row["u.a"]))
        row["udot.x"], row["udot.a"] = (f"{factor * v:.{digits}g}" for v in values)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def test_a_table_from_another_language(crane: dc.Mechanism, tmp_path: Path) -> None:
    table = tmp_path / "states.csv"
    dc.write_states(crane, table, count=10)
    with pytest.raises(
        dc.InputError, match=r"states\.csv: column 'udot\.x', row 0.*line 2: found nothing"
    ):
        dc.check_table(crane, table)
    filled(table, 1.0, 17)
    assert dc.check_table(crane, table).verdict.kind == "consistent"
    filled(table, 1.0, 7)  # rounded: no mistake
    assert dc.check_table(crane, table).verdict.kind == "consistent"
    filled(table, 1.01, 7)
    found = dc.check_table(crane, table)
    assert found.verdict.kind == "equation-error" and {b.speed for b in found.blame} == {"x", "a"}


def test_a_table_of_another_program(crane: dc.Mechanism, tmp_path: Path) -> None:
    """Separators, decimal commas and a row of units are read as those of logs are."""
    table = tmp_path / "states.csv"
    dc.write_states(crane, table, count=10)
    filled(table, 1.01, 7)
    plain = dc.check_table(crane, table)
    head, *rows = table.read_text().splitlines()
    units = ["s", "m", "rad", "m/s", "rad/s", "m/s^2", "rad/s^2"]
    lines = [head, ",".join(units), *rows]
    foreign = "\n".join(lines).replace(",", ";").replace(".", ",")
    table.write_text(foreign.replace("q,", "q.").replace("u,", "u.").replace("udot,", "udot."))
    assert dc.check_table(crane, table).worst == pytest.approx(plain.worst, rel=1e-12)
    table.write_text("\n".join(lines).replace("rad,", "deg,"))
    with pytest.raises(dc.InputError, match="column 'q.a' is in deg; expected SI units"):
        dc.check_table(crane, table)


def test_a_table_that_is_none_is_named(crane: dc.Mechanism, tmp_path: Path) -> None:
    table = tmp_path / "states.csv"
    for text, words in (
        ("t,q.x\n0,1\n", "no column 'q.a'"),
        ("t,q.x\n0\n", "1 fields, expected 2"),
    ):
        table.write_text(text, "utf-8")
        with pytest.raises(dc.InputError, match=words):
            dc.check_table(crane, table)
    with pytest.raises(dc.InputError, match="no such file"):
        dc.check_table(crane, tmp_path / "none.csv")


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a compiler of C")
def test_a_shared_library(crane: dc.Mechanism, tmp_path: Path) -> None:
    (tmp_path / "eom.c").write_text(
        "#include <math.h>\n"
        "void rhs(double t, const double *q, const double *u, double *udot) {\n"
        f"  double m = {M}, l = {L}, g = {G}, s = sin(q[1]), c = cos(q[1]);\n"
        "  udot[0] = m * s * (l * u[1] * u[1] + g * c) / (2 + m * s * s);\n"
        "  udot[1] = -(udot[0] * c + g * s) / l;\n}\n",
        "utf-8",
    )
    library = tmp_path / "libeom.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, tmp_path / "eom.c", "-lm"], check=True)
    rhs = load_equations(f"{library}:rhs")
    assert dc.check_equations(crane, rhs, count=12).verdict.kind == "consistent"
    with pytest.raises(dc.InputError, match="undefined symbol"):
        load_equations(f"{library}:none")
