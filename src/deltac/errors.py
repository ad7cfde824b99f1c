"""What deltac raises: errors that name the thing, what was found, what was expected, the remedy."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable
from itertools import islice
from typing import Any


class DeltacError(Exception):
    """Base of every error that deltac raises on purpose."""


class InputError(DeltacError, ValueError):
    """The input cannot be used as it is; the message says what to change (exit status 2)."""


class SuspicionWarning(UserWarning):
    """Input that can be used, but looks like a slip."""


def closest(name: str, options: Iterable[str]) -> str:
    """The tail of an "unknown name" message: the closest match, else what is known.

    Of foreign files names may be many and long: compared are the first thousands, of usual length.

    >>> closest("elbwo", ["elbow", "wrist"])
    "; did you mean 'elbow'?"
    >>> closest("x", ["elbow", "wrist"])
    '; known: elbow, wrist'
    """
    known = [option for option in islice(options, _MANY) if len(option) <= _LONG]
    match = difflib.get_close_matches(name[:_LONG], known, n=1, cutoff=0.6)
    if match:
        return f"; did you mean {match[0]!r}?"
    return f"; known: {listed(known)}" if known else "; none are defined"


def listed(names: Iterable[str]) -> str:
    """The first dozen names, separated by commas.

    >>> listed("abcdefghijklmnop")
    'a, b, c, d, e, f, g, h, i, j, k, l, …'
    """
    first = list(islice(names, 13))
    return ", ".join(name[:_LONG] for name in first[:12]) + (", …" if len(first) > 12 else "")


def shown(value: Any) -> str:
    """`repr` of a value from a file, short however large or deep it is.

    >>> shown([1, [2, [3, [4, [5]]]]]), shown("x" * 1000)[:5]
    ('[1, [2, [3, [...]]]]', "'xxxx")
    """
    try:
        return _short.repr(value)
    except ValueError:  # an integer of too many digits to be written
        return f"an integer of {value.bit_length()} bits"


_MANY, _LONG = 5000, 200

_short = reprlib.Repr()
_short.maxlevel = 3
_short.maxstring = _short.maxother = _short.maxlong = 80
