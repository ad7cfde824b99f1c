"""`Picture`, the figure that results draw: it keeps our style when it is written, and shows itself."""

from __future__ import annotations

import io
from typing import Any

from deltac.errors import requirement
from deltac.report.style import WIDTH, entitle, styled

with requirement(
    "figures need matplotlib: pip install 'deltac[figures]'; pages (report=, --report) do without"
):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure


class Picture(Figure):
    """A figure of matplotlib without pyplot; all of matplotlib's methods work on it."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        FigureCanvasAgg(self)

    def savefig(self, fname: Any, **options: Any) -> None:
        """Write the figure, in the style it was drawn in."""
        with styled():
            super().savefig(fname, **options)

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=100)
        return file.getvalue()


def blank(
    height: float, title: str, *, width: float = WIDTH, below: float = 0.5, right: float = 0.14
) -> Figure:
    """An empty figure (inches) with its title, and room `below` and `right` of the panels.

    Margins are set by hand: matplotlib's automatic layout takes longer than all the drawing.
    """
    figure = Picture(figsize=(width, height))
    figure.subplots_adjust(
        left=0.72 / width,
        right=1 - right / width,
        bottom=below / height,
        top=1 - 0.62 / height,
    )
    figure.suptitle("", fontsize=12, fontweight="bold", x=0.12 / width, ha="left")
    figure.texts[0].set_y(1 - 0.1 / height)
    entitle(figure, title)
    return figure
