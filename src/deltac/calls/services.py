"""Services: what a value offers, and a package above it carries out.

A result is drawn by the report, a run's kinematics are computed by the analysis. The value asks for the
service by name; which module has it is declared by the root of the package (`deltac/__init__.py`), which
stands above all. So no import goes up.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

_MODULES: dict[str, str] = {}


def provide(modules: Mapping[str, str]) -> None:
    """Declare services: name of a function -> the module that has it, loaded on first use."""
    _MODULES.update(modules)


def provided() -> Mapping[str, str]:
    """The services that are declared."""
    return _MODULES


def service(name: str) -> Any:
    """The function that carries a service out."""
    return getattr(import_module(_MODULES[name]), name)
