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


def registered(group: str, name: str) -> Any:
    """What another package registers under a name, by an entry point of that group; None where none does."""
    from importlib.metadata import entry_points

    points = entry_points(group=group, name=name)
    return next(iter(points)).load() if points else None


def on_first_use(
    name: str, file: str, group: str = ""
) -> tuple[list[str], Callable[[str], Any], Callable[[], Any]]:
    """``__all__``, ``__getattr__`` (PEP 562) and ``__dir__`` of the package of that `name` and `file`.

    Names that other packages register as entry points of `group` are names of the package, too.
    """
    homes = listed(file)

    def load(attribute: str) -> Any:
        if attribute in homes:
            return getattr(import_module(homes[attribute]), attribute)
        value = registered(group, attribute) if group and not attribute.startswith("_") else None
        if value is None:
            raise AttributeError(f"module {name!r} has no attribute {attribute!r}")
        return value

    return sorted(homes), load, lambda: sorted(homes)
