"""Trajectories: what happened, and the versioned log schema that carries it, in several formats.

The names are loaded on first use: a run that is simulated needs no reader of files.
"""

from __future__ import annotations

from deltac.calls.stubs import on_first_use

__all__, __getattr__, __dir__ = on_first_use(__name__, __file__)
