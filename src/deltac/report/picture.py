"""`Picture`, the figure that results draw: it keeps our style when it is written, and shows itself."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from deltac.report.style import styled


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
