"""Descriptions of other programs as mechanisms and equations: MJCF, URDF, SymPy.

The names are loaded on first use: reading a model does without CasADi.
"""

from __future__ import annotations

from deltac.calls.stubs import on_first_use

__all__, __getattr__, __dir__ = on_first_use(__name__, __file__)
