"""Recorders: runs of other simulators as trajectories.

The names are loaded on first use, so that each recorder meets only the packages that it needs. Other
packages add their own by entry points of the group ``deltac.recorders``: ``record_x = "module:function"``.
"""

from __future__ import annotations

from deltac.calls.stubs import on_first_use

__all__, __getattr__, __dir__ = on_first_use(__name__, __file__, "deltac.recorders")
