"""deltac: energy testing functions for multibody simulations.

The public names are loaded on first use, so that ``import deltac`` stays light. They are listed
once, in ``__init__.pyi``: type checkers read that stub, and so does this module.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

#: public name -> the module that defines it
_PUBLIC: dict[str, str] = {
    alias.name: str(statement.module)
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8")).body
    if isinstance(statement, ast.ImportFrom)
    for alias in statement.names
}

#: names of version 0.1 -> what to write now; to go in the next release
_RENAMED: dict[str, str] = {"Advice": "deltac.Recommendation"}

__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    """Load a public name on its first use (PEP 562)."""
    if name in _RENAMED:
        from deltac.deprecation import warn_renamed

        warn_renamed(f"deltac.{name}", _RENAMED[name])
        home, _, name = _RENAMED[name].rpartition(".")
        return getattr(import_module(home), name)
    module = _PUBLIC.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    subpackage = module == __name__
    value = (
        import_module(f"{module}.{name}") if subpackage else getattr(import_module(module), name)
    )
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*_PUBLIC, "__version__", "__doc__"})
