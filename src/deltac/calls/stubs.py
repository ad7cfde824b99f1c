"""Packages whose names are loaded on first use, and listed once, in the stub that type checkers read."""

from __future__ import annotations

import ast
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def listed(package: str) -> dict[str, str]:
    """Public name -> the module that defines it, of the ``__init__.pyi`` beside an ``__init__.py``."""
    return {
        alias.name: str(statement.module)
        for statement in ast.parse(Path(package).with_suffix(".pyi").read_text("utf-8")).body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }


def on_first_use(name: str, file: str) -> tuple[list[str], Callable[[str], Any], Callable[[], Any]]:
    """``__all__``, ``__getattr__`` (PEP 562) and ``__dir__`` of the package of that `name` and `file`."""
    homes = listed(file)

    def load(attribute: str) -> Any:
        if attribute not in homes:
            raise AttributeError(f"module {name!r} has no attribute {attribute!r}")
        return getattr(import_module(homes[attribute]), attribute)

    return sorted(homes), load, lambda: sorted(homes)
