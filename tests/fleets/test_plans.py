"""Plans of sweeps: what is wrong is named with its line, points are where they should be."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from deltac.errors import InputError, UnknownName
from deltac.fleets.design import lay_out
from deltac.fleets.spec import make_spec, read_spec
from deltac.fleets.sweep import plan_sweep
from deltac.foreign.limits import line_of

PLAN = """\
# a sweep
model = "double-pendulum"
duration = 1.0
step = 0.01

[vary]
solver = [
    "ode4",
    "ode5",
]

[vary.parameter]
m1 = [0.5, 1.0]
l2 = { from = 0.5, to = 2.0, count = 3, scale = "log" }

[vary.q]
joint1 = ["30deg"]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "plan.toml"
    path.write_text(text)
    return path


def test_a_file(tmp_path: Path) -> None:
    spec = read_spec(written(tmp_path, PLAN))
    design = lay_out(spec)
    assert spec.name == "plan" and len(design) == 12
    assert design.axes == ("parameter.m1", "parameter.l2", "q.joint1")
    assert [s.solver for s in design.settings] == ["ode4", "ode5"]
    expected = list(itertools.product([0.5, 1.0], [0.5, 1.0, 2.0], [np.pi / 6]))
    np.testing.assert_allclose(design.values[:6], expected, rtol=1e-15)
    np.testing.assert_array_equal(design.values[6:], design.values[:6])


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("step = 0.01", "stepp = 0.01", 4, "'step'"),
        ("step = 0.01", "step = -0.01", 4, "step"),
        ('"ode5",\n]', "5,\n]", 7, "vary.solver"),
        ("m1 = [0.5, 1.0]", "m1 = [0.5, 'x']", 13, "m1"),
        ("m1 = [0.5, 1.0]", "m1 = []", 13, "m1"),
        ("count = 3", "cuont = 3", 14, "'count'"),
        ("from = 0.5, ", "", 14, "from"),
        ("to = 2.0", "to = 0.25", 14, "from"),
        ("from = 0.5", "from = 0.0", 14, "logarithmic"),
        ("[vary.q]", "[vary.qq]", 16, "'q'"),
        ("[vary.q]", "[vary.q", 16, "TOML"),
        ("duration = 1.0", "tolerance = nan", 3, "tolerance"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(
    old: str, new: str, line: int, words: str, tmp_path: Path
) -> None:
    assert old in PLAN
    with pytest.raises(InputError) as found:
        read_spec(written(tmp_path, PLAN.replace(old, new)))
    assert f"line {line}" in str(found.value) and words in str(found.value)


def test_lines_of_long_files() -> None:
    text = "".join(
        f"[t{k}]\na = [\n  {k},\n  2,\n]\n\n# comment\n\nb.c = '''\nx = 1\n'''\n" for k in range(60)
    )
    lines = text.splitlines()
    for k in range(0, 60, 7):
        start = lines.index(f"[t{k}]")
        assert line_of(text, f"t{k}.a.1") == start + 2
        assert line_of(text, f"t{k}.b.c") == start + 9


def test_the_line_of_a_quoted_name_with_a_dot() -> None:
    text = '[vary]\n"parameter.m" = [1, 2]\nq.hip = 0\n'
    assert line_of(text, "vary.parameter.m.0") == 2
    assert line_of(text, "vary.q.hip") == 3


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ({"design": {"kind": "list"}}, "without points"),
        ({"design": {"kind": "sobol"}, "vary": {"q": {"joint1": [0.1]}}}, "points"),
        ({"design": {"kind": "sobol", "points": 4}}, "none is varied"),
        ({"vary": {"q": {"joint1": {"from": 0.0, "to": 1.0}}}}, "count"),
        ({"vary": {"parameter": {"m3": [1.0]}}}, "m1"),
        ({"vary": {"u": {"joint3": [1.0]}}}, "joint2"),
        ({"vary": {"solver": ["ode55"]}}, "ode5"),
        ({"step": 0.3}, "divide"),
        ({"vary": {"step": [0.1, 0.1]}}, "twice"),
        ({"step": 0.1, "vary": {"step": [0.1]}}, "leave one of them out"),
        (
            {"design": {"kind": "list"}, "vary": {"step": [0.1], "q": {"joint1": [0.1, 0.2]}}},
            "equally many",
        ),
        ({"model": "double-pendulun"}, "double-pendulum"),
        ({"model": None}, "model"),
    ],
)
def test_plans_that_cannot_be_run(plan: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        plan_sweep({"model": "double-pendulum", "duration": 1.0, **plan})


def test_unknown_names_have_their_code() -> None:
    with pytest.raises(UnknownName):
        make_spec({"modle": "x"})


@pytest.mark.parametrize("kind", ["latin-hypercube", "sobol"])
def test_random_designs_fill_the_space(kind: str) -> None:
    """Each half, quarter and eighth of every axis holds its share of the points; twice the same."""
    n = 64
    plan = {
        "design": {"kind": kind, "points": n, "seed": 3},
        "vary": {
            "solver": ["ode4", "ode5"],
            "parameter": {
                "m1": {"from": 1.0, "to": 3.0},
                "l2": {"from": 0.1, "to": 10.0, "scale": "log"},
                "g": [1.0, 2.0],
            },
        },
    }
    design = lay_out(make_spec(plan))
    assert len(design) == 2 * n
    np.testing.assert_array_equal(design.values[:n], design.values[n:])
    np.testing.assert_array_equal(design.values, lay_out(make_spec(plan)).values)
    m, l, g = design.values[:n].T
    for unit in ((m - 1.0) / 2.0, np.log10(l) / 2.0 + 0.5):
        assert np.bincount((unit * 8).astype(int)).tolist() == [n // 8] * 8
    assert (g == 1.0).sum() == n // 2


def test_a_list_takes_the_kth_value_of_everything() -> None:
    plan = {
        "design": {"kind": "list"},
        "vary": {"solver": ["ode4", "ode5", "ode4"], "q": {"joint1": [0.1, 0.2, 0.3]}},
    }
    design = lay_out(make_spec(plan))
    assert design.setting.tolist() == [0, 1, 0] and design.values[:, 0].tolist() == [0.1, 0.2, 0.3]


def test_addresses_are_of_what_determines_the_answer() -> None:
    plan = {"model": "double-pendulum", "duration": 1.0, "step": 0.1}

    def addresses(**more: object) -> tuple[str, ...]:
        return plan_sweep({**plan, **more}).addresses

    axes = {"parameter": {"m1": [1.0, 2.0], "m2": [3.0]}, "q": {"joint1": [0.5]}}
    turned = {"q": {"joint1": [0.5]}, "parameter": {"m2": [3.0], "m1": [1.0, 2.0]}}
    before = addresses(vary=axes)
    assert len(set(before)) == 2
    assert addresses(vary=turned) == before, "the order of axes does not count"
    assert addresses(vary=axes, name="other", execution={"chunk": 1}) == before
    longer = {**axes, "parameter": {"m1": [1.0, 1.5, 2.0], "m2": [3.0]}}
    assert set(before) < set(addresses(vary=longer)), "what was there keeps its address"
    for other in (
        {"step": 0.05},
        {"tolerance": 1e-4},
        {"parameter": {"l1": 2.0}},
        {"solver": "ode4"},
    ):
        assert not set(before) & set(addresses(vary=axes, **other))


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_list_of_points_from_a_table(ending: str, tmp_path: Path) -> None:
    """The same addresses as those of the values written out; the table lies beside the plan."""
    values = {
        "solver": ["ode4", "ode5", "ode4"],
        "parameter.m1": [1.0, 2.0, 3.0],
        "q.joint1": [0.1, 0, 1],
    }
    frame = pl.DataFrame(values, strict=False)
    frame.write_csv(tmp_path / "points.csv")
    frame.write_parquet(tmp_path / "points.parquet")
    base = 'model = "double-pendulum"\nduration = 1.0\nstep = 0.1\n[design]\nkind = "list"\n'
    plan = plan_sweep(str(written(tmp_path, f'{base}file = "points.{ending}"\n')))
    given = {
        "model": "double-pendulum", "duration": 1.0, "step": 0.1, "design": {"kind": "list"},
        "vary": {
            "solver": values["solver"],
            "parameter": {"m1": values["parameter.m1"]},
            "q": {"joint1": [0.1, 0.0, 1.0]},
        },
    }  # fmt: skip
    assert plan.addresses == plan_sweep(given).addresses
    more = {"parameter": {"l1": [1.0, 2.0, 3.0]}}
    both = {**given, "vary": more, "design": {"kind": "list", "file": str(tmp_path / "points.csv")}}
    assert plan_sweep(both).design.axes == ("parameter.l1", "parameter.m1", "q.joint1")


@pytest.mark.parametrize(
    ("table", "design", "words"),
    [
        ("parameter.m1\n1\n", {"kind": "grid"}, "list"),
        ("parameter.m1\n1\nx\n", {}, "row|parameter.m1.1"),
        ("parameter.m1,q.joint1\n1,2\n3,\n", {}, "row 1"),
        ("parameter.m1\n", {}, "no rows"),
        ("mass\n1\n", {}, "mass"),
        ("step\n-1\n", {}, "step"),
        ("parameter.m7\n1\n", {}, "m1"),
        ("q.joint1\n1\n", {"file": "none.csv"}, "none.csv"),
        ("q.joint1\n1\n", {"file": "points.xlsx"}, "csv"),
    ],
)
def test_tables_of_points_that_cannot_be_used(
    table: str, design: dict[str, str], words: str, tmp_path: Path
) -> None:
    (tmp_path / "points.csv").write_text(table)
    (tmp_path / "points.xlsx").write_text("")
    spec = {"kind": "list", "file": "points.csv", **design}
    spec["file"] = str(tmp_path / spec["file"])
    with pytest.raises(InputError, match=words):
        plan_sweep({"model": "double-pendulum", "duration": 1.0, "step": 0.1, "design": spec})


def test_steps_and_tolerances_are_of_the_solvers_that_have_them() -> None:
    plan = plan_sweep(
        {
            "model": "double-pendulum",
            "duration": 1.0,
            "vary": {
                "solver": ["ode4", "DOP853"],
                "step": [0.1, 0.05],
                "solver_tolerance": [1e-6, 1e-9, 1e-12],
                "q": {"joint1": [0.1, 0.2]},
            },
        }
    )
    found = [(task.solver, task.step, task.solver_tolerance) for task in plan.tasks]
    assert found == [
        ("ode4", 0.1, None),
        ("ode4", 0.05, None),
        ("DOP853", None, 1e-6),
        ("DOP853", None, 1e-9),
        ("DOP853", None, 1e-12),
    ]
    assert plan.design.setting.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert len(set(plan.addresses)) == 10


def test_of_several_models_each_is_refused_by_itself(tmp_path: Path) -> None:
    """One that is broken, one without the axis; a lone one is an error of the plan."""
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody>")
    names = ["double-pendulum", str(tmp_path / "broken.xml"), "simple-pendulum"]
    plan = {"duration": 1.0, "step": 0.1, "vary": {"parameter": {"m1": [1.0, 2.0]}}}
    plan["vary"] |= {"model": names}  # type: ignore[operator]
    made = plan_sweep(plan)
    failures = [getattr(task, "failure", None) for task in made.tasks]
    assert [f and f.code for f in failures] == [None, "E-MODEL", "E-NAME"]
    assert len(set(made.addresses)) == 6
    piece = made.piece([2, 3])
    row = piece.table(piece())
    assert row["verdict"].to_list() == ["failed"] * 2 and row["parameter.m1"].to_list() == [
        1.0,
        2.0,
    ]
    plan["vary"] |= {"model": names[1:]}  # type: ignore[operator]
    with pytest.raises(InputError):
        plan_sweep(plan)
