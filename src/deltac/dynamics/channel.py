"""What a channel of energy flow is, in symbols."""

from __future__ import annotations

from dataclasses import dataclass

from deltac.dynamics.spatial import SX
from deltac.mechanism.channels import ChannelName


@dataclass(frozen=True)
class Channel:
    """One channel of energy flow.

    `force` (nu,) is its generalized force on all speeds. A potential channel has the energy
    `potential` (J). `explicit` (W) is power that belongs to no force: ∂V/∂t of a potential whose law
    depends on time. `logged` marks a motor whose value comes from a controller or a log.
    """

    name: ChannelName
    force: SX
    potential: SX | None = None
    explicit: SX | None = None
    logged: bool = False
