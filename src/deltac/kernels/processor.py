"""What the processor is and can do, as Linux tells it."""

from __future__ import annotations

import platform
from functools import cache
from pathlib import Path

_TELLING = {
    *("vendor_id", "cpu family", "model", "model name", "stepping", "flags"),  # x86
    *("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "CPU revision", "Features"),
}
"""Lines of /proc/cpuinfo that say which code may run; others change from boot to boot."""


@cache
def processor() -> tuple[tuple[str, str], ...]:
    """Pairs (what, which) that are the same on processors that run the same code."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    first = text.partition("\n\n")[0]  # processors of a machine are told one after the other
    pairs = (line.partition(":") for line in first.splitlines())
    told = tuple((what.strip(), which.strip()) for what, _, which in pairs)
    return (
        ("machine", platform.machine()),
        ("processor", platform.processor()),
        *(pair for pair in told if pair[0] in _TELLING),
    )


def flags() -> set[str]:
    """The instruction sets of an x86 processor; nothing elsewhere."""
    return set(dict(processor()).get("flags", "").split())
