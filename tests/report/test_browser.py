"""Pages in a real browser: no error, no request, the mechanism where the run has it, one cursor for all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.analysis.kinematics import kinematics
from deltac.report.page import document
from deltac.report.page.parts import Chapter, Page, Told
from deltac.report.page.scene import scene
from deltac.report.panels import Line, TimePlot
from deltac.results import Finding

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("there is no chromium; install Debian's package chromium", allow_module_level=True)

EVIL = '<img src=x onerror="window.hit=1"></script><script>window.hit=1</script>'


class Opened:
    """A page in the browser, and what it complained of or asked for."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.requests: list[str] = []
        page.on("console", self._heard)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))

    def _heard(self, message: Any) -> None:
        stall = "GPU stall" in message.text  # of the software renderer that reads its picture back
        if message.type in ("error", "warning") and not stall:
            self.complaints.append(message.text)

    def __call__(self, script: str, argument: Any = None) -> Any:
        return self.page.evaluate(script, argument)


@pytest.fixture(scope="module")
def mechanism() -> dc.Mechanism:
    return dc.Mechanism(
        [dc.rod("upper", 1.0, 0.7, along="-y"), dc.rod(EVIL, 0.5, 0.4, along="-y")],
        [
            dc.revolute("shoulder", "ground", "upper", axis="z"),
            dc.revolute("elbow", "upper", EVIL, axis="z", position=(0, -0.7, 0)),
        ],
        gravity=(0, -9.81, 0),
    )


@pytest.fixture(scope="module")
def run(mechanism: dc.Mechanism) -> dc.Trajectory:
    return dc.simulate(mechanism, mechanism.state({"shoulder": 1.0, "elbow": 0.6}), 3.0, 0.01)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def opened(
    browser: Any,
    mechanism: dc.Mechanism,
    run: dc.Trajectory,
    tmp_path_factory: pytest.TempPathFactory,
) -> Opened:
    """A page with two plots of different rows, a finding at 1.25 s, and names with markup."""
    fine = np.linspace(0.0, 3.0, 301)
    made = Page(
        EVIL,
        EVIL,
        "bad",
        EVIL,
        EVIL,
        numbers=((EVIL, EVIL),),
        chapters=(
            Chapter(
                EVIL,
                (
                    TimePlot(
                        "angles",
                        run.t,
                        (Line(EVIL, run.q[:, 0]), Line("elbow", run.q[:, 1])),
                        "rad",
                    ),
                    TimePlot("sizes", fine, (Line("y", 1e-9 + fine**4, bar=fine),), "J", log=True),
                ),
                (Told(Finding("gravity", EVIL, EVIL, EVIL, "cause", EVIL), 1.25, EVIL),),
            ),
        ),
        scene=scene(mechanism, [(EVIL, run)]),
        limits=(EVIL,),
        made=((EVIL, EVIL),),
    )
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(document(made, EVIL), "utf-8")
    found = Opened(browser.new_page(reduced_motion="reduce"))
    found.page.goto(path.as_uri())
    found("() => { for (const p of deltac.plots) if (!p.ready) p.draw(); }")
    return found


def test_it_complains_of_nothing_and_asks_for_nothing(opened: Opened) -> None:
    opened.page.wait_for_timeout(100)
    assert opened.complaints == []
    assert len([url for url in opened.requests if not url.startswith(("data:", "blob:"))]) == 1


def test_names_are_text(opened: Opened) -> None:
    assert opened("window.hit") is None
    assert opened("document.images.length") == 0
    assert opened("document.querySelector('h1').textContent") == EVIL
    assert opened("document.title").startswith(EVIL)


def test_the_mechanism_moves_where_the_run_has_it(
    opened: Opened, mechanism: dc.Mechanism, run: dc.Trajectory
) -> None:
    where = kinematics(mechanism, run)
    place, turn = where.position(EVIL), where.orientation(EVIL)
    for row in (0, 77, 300):
        pose = opened(
            "t => { deltac.clock.set(t); return deltac.player.stage.pose(0, 2); }", run.t[row]
        )
        np.testing.assert_allclose(pose[:3], place[row], atol=1e-6)
        x, y, z, w = pose[3:]
        cosine, sine = w * w - z * z, 2 * w * z  # it turns about z only
        np.testing.assert_allclose([x, y], 0.0, atol=1e-6)
        np.testing.assert_allclose([cosine, sine], turn[row][:2, 0], atol=1e-6)


def test_playing_changes_the_picture(opened: Opened) -> None:
    canvas = opened.page.locator("canvas.stage")
    opened("() => { deltac.player.play(false); deltac.clock.set(0.5); }")
    opened.page.wait_for_timeout(60)
    before = canvas.screenshot()
    opened.page.locator("body").press("Space")
    for _ in range(
        100
    ):  # the page allows no evaluation of strings, which waiting for a function needs
        opened.page.wait_for_timeout(50)
        if opened("deltac.clock.t") > 0.6:
            break
    opened.page.locator("body").press("Space")
    assert not opened("deltac.player.playing")
    assert canvas.screenshot() != before


def test_plots_and_scene_share_one_cursor(opened: Opened) -> None:
    over = opened.page.locator(".u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    opened.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    opened.page.wait_for_timeout(60)
    t = opened("deltac.clock.t")
    assert t == pytest.approx(1.5, abs=0.02)
    marks = opened(
        "() => [...document.querySelectorAll('.now')].map(n => new DOMMatrix(n.style.transform).e"
        " / n.parentElement.clientWidth)"
    )
    np.testing.assert_allclose(marks, t / 3.0, atol=0.01)
    assert opened("document.querySelector('.time').textContent") == f"{t:.4g} s"


def test_a_finding_leads_to_its_instant(opened: Opened) -> None:
    opened.page.mouse.move(0, 0)
    opened.page.locator(".jump").click()
    assert opened("deltac.clock.t") == 1.25


def test_zoom_is_shared_and_undone(opened: Opened) -> None:
    opened("() => deltac.clock.zoom(1, 2)")
    scales = "() => deltac.plots.map(p => [p.u.scales.x.min, p.u.scales.x.max])"
    opened.page.wait_for_timeout(60)
    assert opened(scales) == [[1, 2], [1, 2]]
    opened("() => deltac.clock.whole()")
    opened.page.wait_for_timeout(60)
    assert opened(scales) == [[0, 3], [0, 3]]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_screen(opened: Opened, scheme: str, width: int) -> None:
    opened.page.emulate_media(color_scheme=scheme)
    opened.page.set_viewport_size({"width": width, "height": 800})
    opened.page.wait_for_timeout(400)
    assert opened("document.documentElement.scrollWidth") <= width
    assert opened("document.documentElement.dataset.theme") == scheme
    assert opened.complaints == []


def test_csv_has_what_the_plot_shows(opened: Opened, run: dc.Trajectory, tmp_path: Path) -> None:
    with opened.page.expect_download() as waiting:
        opened.page.get_by_role("button", name="download angles as CSV").click()
    path = tmp_path / "angles.csv"
    waiting.value.save_as(path)
    rows = path.read_text("utf-8").splitlines()
    assert len(rows) == len(run) + 1
    columns = np.array([row.split(",") for row in rows[1:]], dtype=float)
    np.testing.assert_array_equal(columns[:, 0], run.t)
    np.testing.assert_allclose(columns[:, 2], run.q[:, 1], rtol=1e-6)


def test_keys_step(opened: Opened) -> None:
    opened("() => deltac.clock.set(0)")
    opened.page.locator("body").press("ArrowRight")
    assert opened("deltac.clock.t") == pytest.approx(0.01)
    opened.page.locator("body").press("End")
    assert opened("deltac.clock.t") == 3.0


@pytest.mark.slow
def test_a_million_samples_of_sixty_channels(browser: Any, tmp_path: Path) -> None:
    import time

    t = np.linspace(0.0, 1000.0, 1_000_000)
    rng = np.random.default_rng(1)
    lines = tuple(Line(f"channel {k}", rng.normal(size=len(t)), shown=k < 8) for k in range(60))
    start = time.process_time()
    made = Page("", "", "plain", "", "", chapters=(Chapter("", (TimePlot("all", t, lines, "J"),)),))
    path = tmp_path / "large.html"
    path.write_text(document(made), "utf-8")
    assert time.process_time() - start < 5.0
    assert path.stat().st_size < 8e6
    page = browser.new_page()
    page.goto(path.as_uri())
    assert (
        page.evaluate("performance.timing.loadEventEnd - performance.timing.navigationStart") < 4000
    )
