"""Values of laws and quantities as plain numbers, for descriptions and initial states."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from deltac.errors import InputError
from deltac.mechanism.laws import symbol_names


def evaluate(law: Any, values: Mapping[str, float]) -> float:
    """The value of a law where its symbols have `values`; InputError if it is not a finite number."""
    if isinstance(law, float):
        return law
    missing = sorted(symbol_names(law) - set(values))
    if missing:
        raise InputError(f"no value is known for {', '.join(missing)} in {law}")
    named = {symbol: values[symbol.name] for symbol in law.free_symbols}
    try:
        number = float(law.subs(named).evalf(17))
    except TypeError:
        number = math.nan
    if not math.isfinite(number):
        shown = ", ".join(f"{symbol} = {value:g}" for symbol, value in named.items())
        raise InputError(f"{law} is not a finite number at {shown}")
    return number


def rate(law: Any) -> Any:
    """The exact derivative of a law of t."""
    if isinstance(law, float):
        return 0.0
    import sympy

    t = next((symbol for symbol in law.free_symbols if symbol.name == "t"), None)
    return 0.0 if t is None else sympy.diff(law, t)
