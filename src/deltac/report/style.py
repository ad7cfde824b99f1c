"""What all figures look like: one width, one set of colours, legends beside the axes.

Matplotlib without pyplot, so no state. Sizes are in inches: `WIDTH` is that of a page with two columns, so
that a figure can be put into a paper at its own size with its 9 pt and 7.5 pt letters.
"""

from __future__ import annotations

import textwrap
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import Array
from deltac.report.panels import CURVE_POINTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


WIDTH = 7.6
"""Of every figure."""

LEGEND_WIDTH = 1.75
"""Of that, what legends beside the axes take."""

COLOURS = (
    *("#0068a8", "#cf5300", "#6a5acd", "#b0568f", "#b07c00"),
    *("#2d9bd0", "#00868b", "#7a7a00", "#8c4a3a"),
)
"""The palette of figures and pages: what a colour means is the same in all panels of one of them."""

INK, GOOD, BAD, DOUBT = "#1d2126", "#0b7a4b", "#b3261e", "#9a6700"
"""The residual of a balance; what is accepted or right, what is wrong, what is in doubt."""

GREY = "#888888"
SHADES = {
    **{"ink": INK, "ink1": "#4b5563", "ink2": "#6f7985", "ink3": "#929ba5", "ink4": "#b0b7bf"},
    **{"ink5": "#c9ced4", "grey": GREY},
}
"""Colours by name: what is left of a balance, the same at coarser steps, and what is compared with."""

DASHED, DOTTED = (0, (5, 2)), (0, (1, 1.5))


SMALL_TEXT = 7.5
"""Size (pt) of what stands beside or inside the axes."""


STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.solid_capstyle": "round",
    "path.simplify_threshold": 0.5,
    "savefig.dpi": 150,
    "pdf.fonttype": 42,  # letters stay letters, which journals ask for
    "svg.hashsalt": "deltac",  # the same figure is the same file
}

UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
"""Metadata by format, so that the same figure is the same file."""


def styled() -> AbstractContextManager[None]:
    """The style of all figures, for drawing and for writing them."""
    import matplotlib

    default = {k: v for k, v in matplotlib.rcParamsDefault.items() if k != "backend"}
    settings: Any = {**default, **STYLE}  # whatever a matplotlibrc says
    return matplotlib.rc_context(settings)


def entitle(figure: Figure, title: str) -> None:
    """Give a figure another title, cut where it would not fit."""
    most = int(10.5 * figure.get_figwidth())
    figure.texts[0].set_text(title if len(title) <= most else f"{title[: most - 2].rstrip()} …")


def legend_beside(panel: Axes) -> None:
    """The legend, right of the axes, where it covers nothing; long labels are wrapped."""
    handles, labels = panel.get_legend_handles_labels()
    panel.legend(
        handles,
        [fitted(label) for label in labels],
        loc="upper left",
        bbox_to_anchor=(1.01, 1.0),
        fontsize=SMALL_TEXT,
        borderaxespad=0.0,
        handlelength=1.6,
        labelspacing=0.35,
    )


def fitted(label: str, width: int = 27) -> str:
    """A label in lines of so many characters, three at most."""
    lines = textwrap.wrap(label, width) or [""]
    return "\n".join(lines if len(lines) <= 3 else [*lines[:2], f"{lines[2][: width - 2]} …"])


def align_labels(figure: Figure) -> None:
    """The labels of all vertical axes below one another."""
    for panel in figure.axes:
        inches = panel.get_position().width * figure.get_figwidth()
        panel.yaxis.set_label_coords(-0.52 / inches, 0.5)


def thinned(t: Array, y: Array, points: int = CURVE_POINTS) -> tuple[Array, Array]:
    """The curve as it looks, with at most so many points: of each part of the time its extremes.

    A peak of one sample stays.
    """
    if len(t) <= points:
        return t, y
    edges = np.linspace(0, len(t), points // 2 + 1).astype(np.intp)
    rows = [0, len(t) - 1]
    for start, end in zip(edges, edges[1:]):
        rows += [start + int(np.argmin(y[start:end])), start + int(np.argmax(y[start:end]))]
    distinct_rows = np.unique(rows)
    return t[distinct_rows], y[distinct_rows]
