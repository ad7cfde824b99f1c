"""The animated picture of the README: `python website/animation.py` writes docs/images/testing.gif.

The thesis's triple pendulum by right equations and by equations with one wrong sign, and |ΔC| of both.
"""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import deltac as dc
from deltac.arrays import EPS
from deltac.report.page.scene import scene
from deltac.report.picture import blank
from deltac.report.still import draw
from deltac.report.style import BAD, GOOD, styled

TARGET = Path(__file__).parents[1] / "docs" / "images" / "testing.gif"

DURATION, STEP, EVERY = 5.0, 1e-3, 70
"""Of the runs (s), and rows from one picture to the next: it is shown at about real time."""

COLOURS = 28


def frames() -> list[Image.Image]:
    """The pictures, in time order."""
    runs, curves = [], []
    for mistake in (False, True):
        problem = dc.problems.load("triple-pendulum", mistake=mistake)
        run = dc.simulate(
            problem.mechanism, problem.state, DURATION, STEP, "ode5", equations=problem.equations
        )
        ledger = dc.balance(problem.mechanism, run)
        found = scene(problem.mechanism, [("", run)])
        assert found is not None
        runs.append((replace(found, floor=None), run))
        curves.append(np.maximum(np.abs(ledger.delta_c["wang"]), EPS * ledger.energy_exchanged))
    return [_frame(runs, curves, row) for row in range(0, round(DURATION / STEP) + 1, EVERY)]


def _frame(runs: list, curves: list, row: int) -> Image.Image:
    with styled():
        figure = blank(2.9, "One of these pendulums has a wrong sign in its equations", width=7.6)
        grid = figure.add_gridspec(
            1,
            3,
            width_ratios=[1, 1, 1.7],
            left=0.01,
            right=0.985,
            bottom=0.17,
            top=0.8,
            wspace=0.24,
        )
        looks = (("right equations", GOOD), ("wrong equations", BAD))
        for k, ((found, run), (name, colour)) in enumerate(zip(runs, looks)):
            panel = figure.add_subplot(grid[0, k])
            t = np.asarray(found.runs[0].t.values)
            at = int(np.argmin(np.abs(t - run.t[row])))
            draw(panel, found, [max(at - 24, 0), max(at - 12, 0), at], trail=False)
            panel.set_xlim(-0.78, 0.78)
            panel.set_ylim(-0.88, 0.62)
            panel.set_title(name, color=colour, loc="center")
        panel = figure.add_subplot(grid[0, 2])
        for (_, run), curve, (_, colour) in zip(runs, curves, looks):
            panel.semilogy(run.t[: row + 1 : 5], curve[: row + 1 : 5], color=colour, linewidth=1.6)
        panel.set_xlim(0.0, DURATION)
        panel.set_ylim(1e-14, 1e3)
        panel.set_title("|ΔC| (J), Wang's testing function")
        panel.set_xlabel("time t (s)")
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=100)
    return Image.open(file).convert("RGB")


if __name__ == "__main__":
    made = frames()
    coverage = Image.Quantize.MAXCOVERAGE  # white stays white
    shared = made[-1].quantize(COLOURS, method=coverage, dither=Image.Dither.NONE)
    small = [image.quantize(palette=shared, dither=Image.Dither.NONE) for image in made]
    small[0].save(
        TARGET,
        save_all=True,
        append_images=small[1:],
        duration=[EVERY] * (len(small) - 1) + [2500],
        loop=0,
        optimize=True,
    )
    print(f"{TARGET.name}: {len(small)} pictures, {TARGET.stat().st_size // 1024} kB")
