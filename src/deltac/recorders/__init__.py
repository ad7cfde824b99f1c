"""Recorders: runs of other simulators as trajectories.

The names are loaded on first use, so that each recorder meets only the packages that it needs.
"""

from __future__ import annotations

from deltac.calls.stubs import on_first_use

__all__, __getattr__, __dir__ = on_first_use(__name__, __file__)
