"""Whether a log fits into memory, asked before it is read."""

from __future__ import annotations

from pathlib import Path

from deltac.errors import InputError


def require_memory(needed: float, size: str) -> None:
    """Raise InputError when reading would take more bytes than are free; where unknown, pass."""
    free = free_memory()
    if free is not None and needed > free:
        raise InputError(
            f"the log has {size}; reading it whole takes about {needed / 1e9:.1f} GB, and "
            f"{free / 1e9:.1f} GB are free. Store it as Parquet, which is read in parts "
            "(scan_trajectory), or take a part of it."
        )


def free_memory() -> float | None:
    """Bytes that can be had without swapping, as Linux tells; None elsewhere."""
    try:
        lines = Path("/proc/meminfo").read_text("ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return None
    for line in lines:
        if line.startswith("MemAvailable:"):
            return float(line.split()[1]) * 1024.0
    return None
