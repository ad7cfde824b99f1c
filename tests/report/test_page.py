"""The page of a result: what is in it, against closed forms; what is escaped, cut down, refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.report.page import document, html_of
from deltac.report.page.geometry import coarser
from deltac.report.page.parts import PAGE_NUMBERS, Chapter, Page, Stretches
from deltac.report.page.scene import scene
from deltac.report.panels import CURVE_POINTS, Line, TimePlot
from deltac.results import Report, Table
from tests.support.pages import data_of


def plots(contents: dict[str, Any]) -> list[dict[str, Any]]:
    return [p for c in contents["chapters"] for p in c["parts"] if p["kind"] == "time"]


def page(*lines: Line, t: np.ndarray, log: bool = False) -> Page:
    plot = TimePlot("plot", t, lines, "J", log)
    return Page("title", "asked", "plain", "word", "sentence", chapters=(Chapter("", (plot,)),))


@pytest.fixture(scope="module")
def pendulum() -> dc.Mechanism:
    return dc.Mechanism(
        [dc.rod("bar", 2.0, 1.5, along="-y")],
        [dc.revolute("hinge", "ground", "bar", axis="z")],
        gravity=(0, -9.81, 0),
    )


@pytest.fixture(scope="module")
def run(pendulum: dc.Mechanism) -> dc.Trajectory:
    return dc.simulate(pendulum, pendulum.state({"hinge": 1.0}), 2.0, 0.01)


def test_poses_are_those_of_the_closed_form(pendulum: dc.Mechanism, run: dc.Trajectory) -> None:
    made = scene(pendulum, [("run", run)])
    assert made is not None
    poses, angle = made.runs[0].poses.values, run.q[:, 0]
    assert poses.shape == (len(run), 2, 7)
    np.testing.assert_allclose(poses[:, 1, :3], 0.0, atol=1e-15)
    sign = np.sign(poses[:, 1, 6] * np.cos(angle / 2))
    np.testing.assert_allclose(sign * poses[:, 1, 5], np.sin(angle / 2), atol=1e-12)
    (form,) = made.bodies[1].forms  # the inertia of a rod is drawn as one
    assert form.kind == "capsule" and form.size[1] == pytest.approx(1.5)
    np.testing.assert_allclose(form.position, [0.0, -0.75, 0.0])
    np.testing.assert_allclose(made.view, [0, 0, 1], atol=1e-12)


def test_the_force_of_a_pin_carries_the_weight() -> None:
    m, g = 0.7, 9.81
    mechanism = dc.Mechanism(
        [dc.bodies.box("bar", m, (0.1, 1.0, 0.2), (0.0, -0.5, 0.0))],
        [dc.free("float", "bar")],
        constraints=[dc.constraints.loop_spherical("pin", "ground", "bar")],
        gravity=(0.0, -g, 0.0),
    )
    run = dc.simulate(mechanism, mechanism.state(), 0.1, 0.01)  # it hangs at rest
    made = scene(mechanism, [("run", run)])
    assert made is not None
    (arrow,) = made.runs[0].forces
    np.testing.assert_allclose(
        arrow.force.values, np.tile([0.0, m * g, 0.0], (len(run), 1)), atol=1e-9
    )


def test_names_end_no_element_and_numbers_are_json() -> None:
    evil = '</script><script>alert("x")</script><img src=x onerror=alert(1)>{{data}}'
    made = page(Line(evil, np.array([0.0, math.nan, math.inf])), t=np.arange(3.0))
    text = document(made, command=evil)
    assert (
        text.count("<script") == 2
        and evil not in text
        and "<img" not in text.split("<script", 1)[0]
    )
    contents = data_of(text)
    assert plots(contents)[0]["lines"][0]["name"] == evil
    assert contents["made"][0] == ["command", evil]


def test_no_peak_is_lost() -> None:
    rng = np.random.default_rng(0)
    rows = 300_000
    y = rng.normal(size=rows)
    peaks = rng.choice(rows, 50, replace=False)
    y[peaks] = 100.0 + np.arange(50)
    cut = Stretches.of(np.arange(rows) / 1e3, CURVE_POINTS)
    drawn = cut.extremes(y)
    assert len(drawn) == len(cut.t) == 2 * CURVE_POINTS
    stretch = np.searchsorted(cut.starts, np.arange(rows), "right") - 1
    pairs = drawn.reshape(-1, 2)
    assert np.all(pairs.max(axis=1)[stretch] >= y) and np.all(pairs.min(axis=1)[stretch] <= y)
    assert np.isin(drawn, y).all() and np.all(np.diff(cut.t) >= 0)


def test_a_short_history_is_kept_whole() -> None:
    t = np.linspace(0.0, 1.0, 777)
    contents = data_of(document(page(Line("y", np.sin(9 * t)), t=t)))
    (plot,) = plots(contents)
    np.testing.assert_array_equal(plot["t"], t)
    np.testing.assert_array_equal(plot["lines"][0]["y"], np.sin(9 * t).astype("f4"))
    assert plot["whole"]


def test_plots_of_few_curves_are_not_cut_for_those_of_many() -> None:
    t = np.linspace(0.0, 1.0, 2000)
    few = TimePlot("few", t, (Line("y", t, 0.1 * t),), "J")
    # Of the bars of `many` half are narrower than a row of a screen.
    widths = (1e-6, 1e-2) * 100
    many = TimePlot("many", t, tuple(Line(f"{k}", t, w * t) for k, w in enumerate(widths)), "J")
    whole = Page(
        "title", "asked", "plain", "word", "sentence", chapters=(Chapter("", (few, many)),)
    )
    small, large = plots(data_of(document(whole)))
    assert small["whole"] and len(small["lines"][0]["high"]) == len(t)
    assert [("high" in line, "low" in line) for line in large["lines"]] == [
        (w > 1e-3,) * 2 for w in widths
    ]
    points = sum(
        len(line[name]) for line in large["lines"] for name in line.keys() & {"y", "high", "low"}
    )
    assert 0.9 * PAGE_NUMBERS < points + 5 * len(t) <= PAGE_NUMBERS


def test_the_page_of_a_study(tmp_path: Path) -> None:
    found = dc.study("simple-pendulum", steps=[0.2, 0.1, 0.05])
    path = tmp_path / "page.html"
    found.report(path)
    contents = data_of(path.read_text("utf-8"))
    assert contents["tone"] == "good" and contents["word"] == "Consistent"
    assert contents["data"]["verdict"] == "consistent"
    first = plots(contents)[0]
    assert [line["name"] for line in first["lines"]] == ["h = 0.2 s", "h = 0.1 s", "h = 0.05 s"]
    finest = found.runs[-1]
    assert finest.run is not None and finest.energy_error is not None
    np.testing.assert_allclose(
        first["lines"][-1]["y"].max(), np.abs(finest.energy_error[found.function]).max(), rtol=1e-6
    )
    assert len(contents["scene"]["runs"]) == 2
    json.dumps(contents["data"], allow_nan=False)


def test_a_ledger_takes_its_model_and_run(pendulum: dc.Mechanism, run: dc.Trajectory) -> None:
    ledger = dc.balance(pendulum, run)
    assert data_of(html_of(ledger))["scene"] is None
    contents = data_of(html_of(ledger, model=pendulum, run=run))
    assert contents["scene"]["bodies"][1]["name"] == "bar"


def test_any_report_has_a_page() -> None:
    class Plain(Report):
        def summary(self) -> str:
            return "all is well"

        def sections(self) -> Any:
            yield "one <b>paragraph</b>"
            yield Table(("a", "b"), (("1", "2"),))

        def contents(self) -> dict[str, Any]:
            return {}

    contents = data_of(html_of(Plain()))
    assert contents["word"] == "All is well"
    assert [p["kind"] for p in contents["chapters"][0]["parts"]] == ["words", "table"]


def test_a_mesh_is_made_coarser_but_not_smaller() -> None:
    n = 80
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, n), np.linspace(0.01, np.pi - 0.01, n))
    points = np.column_stack(
        [(np.cos(u) * np.sin(v)).ravel(), (np.sin(u) * np.sin(v)).ravel(), np.cos(v).ravel()]
    )
    k = np.arange(n * n).reshape(n, n)
    faces = np.concatenate(
        [
            np.column_stack([k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[:-1, 1:].ravel()]),
            np.column_stack([k[1:, 1:].ravel(), k[:-1, 1:].ravel(), k[1:, :-1].ravel()]),
        ]
    )
    vertices, triangles = coarser(points, faces, 1500)
    assert len(triangles) <= 1500 < len(faces)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), 2.0, atol=0.25)


@pytest.mark.parametrize("name", ["page.pdf", "page", "nowhere/page.html", "folder.html"])
def test_a_path_that_cannot_be_written_is_refused(
    name: str, tmp_path: Path, pendulum: dc.Mechanism, run: dc.Trajectory
) -> None:
    (tmp_path / "folder.html").mkdir()
    with pytest.raises(dc.InputError) as refused:
        dc.balance(pendulum, run).report(tmp_path / name)
    assert refused.value.code == "E-FILE"
    assert [p.name for p in tmp_path.iterdir()] == ["folder.html"]
