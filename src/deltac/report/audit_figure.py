"""The figure of an audit: energies and works over time, and below them what is left."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deltac.report.figures import COLOURS, POINTS, Array, _figure, _stacked, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from deltac.energy import Ledger

MOST_CHANNELS = 5
"""Channels drawn one by one; all smaller ones are drawn as one line."""


def audit_figure(
    title: str, ledger: Ledger, left_over: Array, function: str, allowed: float
) -> Figure:
    """K, V and the works of the largest channels (J); below, `left_over` with its error bar.

    `function` names the testing function that the bar belongs to; `allowed` (J) is drawn as a band.
    """
    with styled():
        figure = _figure(7.6, 6.0, title)
        flows, left = _stacked(figure, [2.2, 1.0], [0.2])
        stride = max(1, len(ledger.t) // POINTS)
        _flows(flows, ledger, stride)
        _left_over(left, ledger, left_over, function, allowed, stride)
        left.set_xlabel("time t (s)")
        for panel in (flows, left):
            panel.yaxis.set_label_coords(-0.52 / 6.74, 0.5)
            panel.margins(x=0)
    return figure


def _flows(panel: Axes, ledger: Ledger, stride: int) -> None:
    t = ledger.t[::stride]
    K, V = ledger.kinetic, ledger.potential_energy
    panel.plot(t, (K - K[0])[::stride], color="#111111", linewidth=1.8, label="K − K(0)")
    panel.plot(
        t,
        (V - V[0])[::stride],
        color="#111111",
        linewidth=1.2,
        linestyle=(0, (5, 2)),
        label="V − V(0)",
    )
    flowing = {n: w - w[0] for n, w in ledger.work.items() if n not in ledger.potential}
    ranked = sorted(flowing.items(), key=lambda item: -float(np.ptp(item[1])))
    shown, rest = ranked[:MOST_CHANNELS], ranked[MOST_CHANNELS:]
    for (name, work), colour in zip(shown, (*COLOURS[:2], *COLOURS[3:], "#e69f00")):
        panel.plot(t, work[::stride], color=colour, linewidth=1.3, label=name)
    if rest:
        others = np.sum([work for _, work in rest], axis=0)
        panel.plot(t, others[::stride], color="#999999", label=f"{len(rest)} smaller channels")
    panel.set_title("Energies, and works of what is not in V")
    panel.set_ylabel("energy (J)")
    panel.legend(loc="best", fontsize=7.5, ncols=2, frameon=True, framealpha=0.8, edgecolor="none")


def _left_over(
    panel: Axes, ledger: Ledger, left_over: Array, function: str, allowed: float, stride: int
) -> None:
    t, left = ledger.t[::stride], left_over[::stride]
    bar = ledger.error_bar[function][::stride]
    panel.axhspan(-allowed, allowed, color="#009e73", alpha=0.10, linewidth=0, label="accepted")
    panel.fill_between(t, left - bar, left + bar, color="#0072b2", alpha=0.25, linewidth=0)
    panel.plot(t, left, color="#0072b2", linewidth=1.2, label="ΔC with its error bar")
    panel.set_title("What is left")
    panel.set_ylabel("ΔC (J)")
    panel.legend(loc="best", fontsize=7.5, ncols=2, frameon=True, framealpha=0.8, edgecolor="none")
