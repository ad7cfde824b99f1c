"""The channels through which energy flows, and their names: a kind and an element.

The power of a channel is positive when it adds energy to the system (W). The kinds are a closed
list, so that logs, ledgers and verdicts of every simulator speak of the same things.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn, TypeAlias

from deltac.arrays import Array
from deltac.errors import ModelError, UnknownName, closest

CHANNEL_KINDS: tuple[str, ...] = (
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

PASSIVE = ("spring", "damper")
"""Kinds whose force is a function of the state: a simulator takes it from its model alone."""


class ChannelName(str):
    """The name of a channel: its `kind`, one of `CHANNEL_KINDS`, and the `element` that it belongs to.

    It is the text ``"<kind> <element>"`` (gravity has no element), so ``ledger.work["damper elbow"]``
    finds what is kept under ``ChannelName("damper", "elbow")``.

    Raises InputError for a kind that is not in `CHANNEL_KINDS`, or an element that is missing.
    """

    __slots__ = ("element", "kind")
    kind: str
    element: str

    def __new__(cls, kind: str, element: str = "") -> ChannelName:
        """Join the two, checked."""
        if kind not in CHANNEL_KINDS:
            raise UnknownName(
                f"channel {f'{kind} {element}'.strip()!r}: expected '<kind> <element>', for example "
                f"'damper elbow'; {kind!r} is no kind of channel{closest(kind, CHANNEL_KINDS)}"
            )
        if not element and kind != "gravity":
            raise ModelError(
                f"channel {kind!r} names no element; expected '{kind} <element>', "
                f"for example '{kind} elbow'."
            )
        name = super().__new__(cls, f"{kind} {element}" if element else kind)
        object.__setattr__(name, "kind", kind)
        object.__setattr__(name, "element", element)
        return name

    @classmethod
    def parse(cls, name: str) -> ChannelName:
        """The channel that a log or a user names as text; InputError as for the class."""
        if isinstance(name, ChannelName):
            return name
        kind, _, element = name.partition(" ")
        return cls(kind, element)

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise AttributeError(f"a channel's name does not change: cannot set {name!r}")

    def __reduce__(self) -> tuple[Any, ...]:
        return ChannelName, (self.kind, self.element)


CORRECTIONS = ("correction kinetic", "correction potential")
"""Integrals of what projections and corrections of the energy did to K and to V, J."""

ENERGY_CORRECTION = ChannelName("correction", "energy")
"""The integral of what corrections of the energy did to K + V, J, and the channel of that work."""

BOOKED = (*CORRECTIONS, ENERGY_CORRECTION)
"""All integrals in which a run books what it corrected."""


@dataclass(frozen=True)
class Channel:
    """One channel of energy flow, in the symbols of a traced mechanism.

    `force` (nu,) is its generalized force on all speeds. A potential channel has the energy
    `potential` (J). `explicit` (W) is power that belongs to no force: ∂V/∂t of a potential whose law
    depends on time. `logged` marks a motor whose value comes from a controller or a log.
    """

    name: ChannelName
    force: Any
    potential: Any = None
    explicit: Any = None
    logged: bool = False


ByChannel: TypeAlias = Mapping[Any, Array]
"""Arrays by channel: the keys are `ChannelName`s, and text finds them."""
