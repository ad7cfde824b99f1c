"""What happens at an instant: impacts, stops of joints, events that a user wants to see."""

from __future__ import annotations

from deltac.mechanism.events import event, impact, joint_stop

__all__ = ["event", "impact", "joint_stop"]
