"""Names of the channels through which energy flows: ``"<kind> <element>"``.

The power of a channel is positive when it adds energy to the system (W). The kinds are a closed
list, so that logs, ledgers and verdicts of every simulator speak of the same things.
"""

from __future__ import annotations

from deltac.errors import ModelError, UnknownName, closest

KINDS: tuple[str, ...] = (
    "gravity",
    "spring",
    "damper",
    "friction",
    "actuator",
    "applied",
    "prescribed",
    "constraint",
    "contact",
    "limit",
    "impact",
    "correction",
)
"""Every kind a channel can have."""


def split(name: str) -> tuple[str, str]:
    """Kind and element of a channel's name; the element of plain ``"gravity"`` is empty.

    Raises InputError for a kind that is not in `KINDS`, or an element that is missing.
    """
    kind, _, element = name.partition(" ")
    if kind not in KINDS:
        raise UnknownName(
            f"channel {name!r}: {kind!r} is no kind of channel{closest(kind, KINDS)}. "
            "A channel is named '<kind> <element>', for example 'damper elbow'."
        )
    if not element and kind != "gravity":
        raise ModelError(
            f"channel {name!r} names no element; expected '{kind} <element>', "
            f"for example '{kind} elbow'."
        )
    return kind, element
