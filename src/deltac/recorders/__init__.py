"""Recorders: runs of other simulators as trajectories.

The names are loaded on first use, so that each recorder meets only the packages that it needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from deltac.calls.stubs import listed

_PUBLIC = listed(__file__)
__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    """Load a recorder on its first use (PEP 562)."""
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_PUBLIC[name]), name)


def __dir__() -> list[str]:
    return __all__
