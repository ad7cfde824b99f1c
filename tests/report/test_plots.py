"""The pictures of results: what they show is what the results hold, and nothing covers anything."""

from __future__ import annotations

import html
import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.report.files import check_figure, write_figure
from deltac.report.panels import CURVE_POINTS
from deltac.report.plots import DRAWN
from deltac.report.style import WIDTH, thinned
from deltac.results import Report, Shown


@pytest.fixture(scope="module")
def rods() -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.rod("upper", "m", "l", along="-y"), dc.rod("lower", "m", "l", along="-y")],
        joints=[
            dc.revolute("shoulder", "ground", "upper", damping=0.02),
            dc.revolute("elbow", "upper", "lower", position=(0, "-l", 0)),
        ],
        gravity=(0, "-g", 0),
        parameters={"m": 1.2, "l": 0.7, "g": 9.81},
        name="rods <b>&",
    )


@pytest.fixture(scope="module")
def results(rods: dc.Mechanism, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Shown]:
    """One of each kind of result that has a picture."""
    start = rods.state({"shoulder": 1.0})
    run = dc.simulate(rods, start, 2.0, 0.01, "ode4")

    def wrong(t: float, q: Any, u: Any) -> Any:
        M = dc.evaluate(rods, rods.state(q, u)).udot
        return M + np.array([0.0, 0.3])

    free = dc.Mechanism(
        [dc.rod("bar", 1.0, 1.0, along="-y")],
        [dc.revolute("pin", "ground", "bar")],
        gravity=(0, -9.81, 0),
    )
    heavier = dc.Mechanism(
        [dc.rod("bar", 1.0, 1.0, along="-y")],
        [dc.revolute("pin", "ground", "bar", damping=0.1)],
        gravity=(0, -9.81, 0),
    )
    light = dc.simulate(free, free.state({"pin": 1.0}), 2.0, 0.01, "ode4")
    source = tmp_path_factory.mktemp("equations") / "eom.py"
    source.write_text(
        "import numpy as np\n\n\ndef rhs(t, q, u):\n    return [-1.5 * 9.81 / 1.0 * np.sin(q[0])]\n"
    )
    return {
        "Mechanism": rods,
        "Trajectory": run,
        "Ledger": dc.balance(rods, run),
        "Audit": dc.audit(heavier, light),
        "Study": dc.study(rods, start, 1.0, steps=(0.02, 0.01, 0.005), solver="ode4"),
        "EquationCheck": dc.check_equations(rods, wrong, count=8),
        "Localisation": dc.localise(heavier, light),
        "Explanation": dc.explain_residual(heavier, light),
        "MutationReport": dc.mutate_equations(free, f"{source}:rhs"),
        "Recommendation": dc.recommend(
            free, free.state({"pin": 1.0}), duration=0.4, solvers=["ode4"]
        ),
        "Examination": dc.examine(free, free.state({"pin": 1.0}), 0.4),
        "Linearisation": dc.linearise(free, free.state({"pin": np.pi})),
    }


def test_every_kind_is_here(results: dict[str, Shown]) -> None:
    assert set(results) == set(DRAWN)
    assert all(type(result).__name__ == name for name, result in results.items())


@pytest.mark.parametrize("name", sorted(DRAWN))
def test_nothing_is_cut_or_covered(results: dict[str, Shown], name: str) -> None:
    """Legends lie outside all axes, all text inside the figure, and every axis says what it shows."""
    figure = results[name].plot()
    assert figure.get_figwidth() == WIDTH
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    page = figure.bbox
    for axes in figure.axes:
        legend = axes.get_legend()
        if legend is not None:
            box = legend.get_window_extent(renderer)
            assert not any(box.overlaps(other.get_window_extent()) for other in figure.axes)
        tight = axes.get_tightbbox(renderer)
        assert tight is not None
        assert tight.x0 >= page.x0 and tight.x1 <= page.x1 + 1
        assert tight.y0 >= page.y0 and tight.y1 <= page.y1 + 1
        assert axes.lines or axes.patches or axes.images or axes.collections
    if name not in ("MutationReport", "Mechanism"):
        assert figure.axes[-1].get_xlabel()


def test_the_figure_of_a_ledger_has_its_numbers(results: dict[str, Shown]) -> None:
    ledger = results["Ledger"]
    assert isinstance(ledger, dc.Ledger)
    energies, works, left, momenta, ends = ledger.plot().axes
    curves = {line.get_label(): line.get_ydata() for p in (energies, works) for line in p.lines}
    K, V = ledger.kinetic, ledger.potential_energy
    np.testing.assert_array_equal(curves["K"], K - K[0])
    np.testing.assert_array_equal(curves["V gravity"], V - V[0])
    np.testing.assert_array_equal(curves["damper shoulder"], ledger.work["damper shoulder"])
    sizes = {line.get_label(): np.asarray(line.get_ydata()) for line in left.lines}
    assert sizes["wang"].max() == np.abs(ledger.delta_c["wang"]).max()
    names = {line.get_label(): np.asarray(line.get_ydata()) for line in momenta.lines}
    for name, values in ledger.delta_p.items():
        share = np.abs(values).max() / ledger.momentum_exchanged[name]
        assert names[name].max() == pytest.approx(share, rel=1e-12)
    widths = [bar.get_width() for bar in ends.patches]  # type: ignore[attr-defined]
    work, last = float(ledger.work["damper shoulder"][-1]), float(ledger.delta_c["wang"][-1])
    stored = sorted([K[-1] - K[0], V[-1] - V[0]], key=lambda x: -abs(x))
    assert widths[0] == pytest.approx(work, rel=1e-12) and widths[-1] == last
    assert widths[1:-1] == pytest.approx(stored, rel=1e-12)


def test_a_peak_of_one_sample_is_drawn() -> None:
    t = np.linspace(0.0, 1.0, 100_001)
    y = np.sin(9.0 * t)
    y[54_321], y[777] = 5.0, -7.0
    few_t, few = thinned(t, y)
    assert len(few) <= CURVE_POINTS + 2 and np.all(np.diff(few_t) > 0)
    assert (few.max(), few.min()) == (5.0, -7.0)
    assert (few_t[0], few_t[-1]) == (0.0, 1.0)
    np.testing.assert_array_equal(few, y[np.searchsorted(t, few_t)])


def test_names_choose_the_curves(results: dict[str, Shown]) -> None:
    panels = results["Trajectory"].plot(names=["elbow"], title="mine")
    assert [line.get_label() for panel in panels.axes for line in panel.lines] == ["elbow"] * 2
    assert panels.texts[0].get_text() == "mine"
    with pytest.raises(dc.InputError, match="elbw"):
        results["Trajectory"].plot(names="elbw")
    with pytest.raises(dc.InputError, match="no option 'colour'"):
        results["Ledger"].plot(colour="red")


def test_what_has_no_picture_says_which_have(results: dict[str, Shown]) -> None:
    study = results["Study"]
    assert isinstance(study, dc.Study)
    with pytest.raises(dc.InputError, match="Verdict has no picture; those of Audit"):
        study.verdict.plot()


@pytest.mark.parametrize("kind", ["pdf", "svg", "png"])
def test_the_same_figure_is_the_same_file(
    results: dict[str, Shown], tmp_path: Path, kind: str
) -> None:
    written = []
    for n in range(2):
        path = tmp_path / f"{n}.{kind}"
        write_figure(results["Linearisation"].plot(), path)
        written.append(path.read_bytes())
    assert written[0] == written[1]
    assert written[0][:5] == {"pdf": b"%PDF-", "svg": b"<?xml", "png": b"\x89PNG\r"}[kind]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("a.gif", ".pdf or .svg"),
        ("a", ".pdf or .svg"),
        ("no/a.pdf", "create it"),
        ("d.svg", "folder"),
    ],
)
def test_paths_that_no_figure_can_be_written_to(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "d.svg").mkdir()
    with pytest.raises(dc.InputError, match=said):
        check_figure(tmp_path / name)


def test_a_still_shows_the_mechanism_where_it_is(rods: dc.Mechanism) -> None:
    """Two rods of 0.7 m, the upper turned by 30°, the lower by 60° in all: centres by hand."""
    state = rods.state({"shoulder": np.pi / 6, "elbow": np.pi / 6})
    panel = rods.plot(state=state).axes[0]
    a, b, l = np.pi / 6, np.pi / 3, 0.7
    upper = 0.5 * l * np.array([np.sin(a), -np.cos(a)])
    lower = 2.0 * upper + 0.5 * l * np.array([np.sin(b), -np.cos(b)])
    drawn = [patch.get_xy()[:-1] for patch in panel.patches]  # type: ignore[attr-defined]
    middles = [
        (xy.min(axis=0) + xy.max(axis=0)) / 2 for xy in drawn if np.ptp(xy, axis=0).max() > 0.2
    ]
    for centre in (upper, lower):
        assert min(np.abs(middle - centre).max() for middle in middles) < 1e-3
    run = dc.simulate(rods, state, 0.5, 0.01, "ode4")
    assert len(rods.plot(state=run).axes[0].patches) == 6 * len(panel.patches)


# --- in notebooks ---------------------------------------------------------------------------------


def test_notebooks_show_everything_escaped(results: dict[str, Shown], rods: dc.Mechanism) -> None:
    for result in (*results.values(), rods):
        shown = result._repr_html_()
        assert html.escape(result.summary()) in shown
        assert "rods <b>" not in shown and "<script" not in shown
        assert len(shown) < 20_000
        assert shown.count("<details>") <= 1


def test_figures_show_themselves(results: dict[str, Shown]) -> None:
    figure = results["Ledger"].plot()
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]


def test_a_page_in_a_notebook_is_shut_off(results: dict[str, Shown]) -> None:
    import xml.etree.ElementTree as tree

    study = results["Study"]
    assert isinstance(study, dc.Study)
    frame = tree.fromstring(study.show()._repr_html_())
    assert frame.tag == "iframe" and frame.attrib["sandbox"] == "allow-scripts allow-downloads"
    assert "</script>" in frame.attrib["srcdoc"] and "rods <b>" not in frame.attrib["srcdoc"]


def test_every_public_report_shows_itself() -> None:
    """What users get from a verb: a Report, or a mechanism or trajectory, which show themselves too."""
    shown: set[str] = {name for name in dc.__all__ if _shows(getattr(dc, name))}
    assert {"Mechanism", "Trajectory", "Repair", *DRAWN} <= shown
    assert issubclass(Report, Shown)


def _shows(found: Any) -> bool:
    return inspect.isclass(found) and issubclass(found, Shown)
