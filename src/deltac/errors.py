"""What deltac raises: errors that name the thing, what was found, what was expected, the remedy."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class DeltacError(Exception):
    """Base of every error that deltac raises on purpose."""


class InputError(DeltacError, ValueError):
    """The input cannot be used as it is; the message says what to change (exit status 2)."""


class UnknownName(InputError, KeyError):
    """A name that is not there; the message says which are."""

    __str__ = Exception.__str__  # a KeyError would show the message in quotes


def closest(name: str, options: Iterable[str]) -> str:
    """The tail of an "unknown name" message: the closest match, else what is known.

    >>> closest("elbwo", ["elbow", "wrist"])
    "; did you mean 'elbow'?"
    >>> closest("x", ["elbow", "wrist"])
    '; known: elbow, wrist'
    """
    known = list(options)
    match = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    if match:
        return f"; did you mean {match[0]!r}?"
    if not known:
        return "; none are defined"
    shown = ", ".join(known[:12]) + (", …" if len(known) > 12 else "")
    return f"; known: {shown}"
