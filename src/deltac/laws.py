"""Symbols for laws that are written as SymPy expressions: the time, coordinates, speeds."""

from __future__ import annotations

from deltac.mechanism.laws import q, time, u

__all__ = ["q", "time", "u"]
