"""Packages whose names are loaded on first use, and listed once, in the stub that type checkers read."""

from __future__ import annotations

import ast
from pathlib import Path


def listed(package: str) -> dict[str, str]:
    """Public name -> the module that defines it, of the ``__init__.pyi`` beside an ``__init__.py``."""
    return {
        alias.name: str(statement.module)
        for statement in ast.parse(Path(package).with_suffix(".pyi").read_text("utf-8")).body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
