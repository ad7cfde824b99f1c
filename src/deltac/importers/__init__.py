"""Descriptions of other programs as mechanisms and equations: MJCF, URDF, SymPy."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from deltac.importers.geoms import read_shapes
from deltac.importers.mujoco import read_mechanism
from deltac.importers.report import ImportReport, Remark

if TYPE_CHECKING:
    from deltac.importers.sympy_equations import (
        SymbolicEquations,
        equations_from_sympy,
        symbolic_equations,
    )

__all__ = [
    "ImportReport",
    "Remark",
    "SymbolicEquations",
    "equations_from_sympy",
    "read_mechanism",
    "read_shapes",
    "symbolic_equations",
]

_LATER = {
    "SymbolicEquations": "sympy_equations",
    "symbolic_equations": "sympy_equations",
    "equations_from_sympy": "sympy_equations",
}


def __getattr__(name: str) -> Any:
    """What works with CasADi is loaded on first use: reading a model does without."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
