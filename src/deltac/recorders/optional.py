"""Simulators that are installed only where they are used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from deltac.errors import InputError


def simulator(module: str, extra: str) -> Any:
    """Import a simulator's module; InputError with the remedy where it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"recording {extra} runs needs the Python module {module!r}, which is not installed "
            f'({error}); run: pip install "deltac[{extra}]"'
        ) from None
