"""Mechanics as matrix algebra on CasADi: the recursions, the terms of the energy theorem, the textbook.

What packages above take of it is listed in the stub, and loaded on first use.
"""

from __future__ import annotations

from deltac.calls.stubs import on_first_use

__all__, __getattr__, __dir__ = on_first_use(__name__, __file__)
