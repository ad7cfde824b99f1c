"""What the processor is and can do, as Linux tells it."""

from __future__ import annotations

import math
import os
import platform
from functools import cache
from pathlib import Path

import numpy as np

from deltac.arrays import Array
from deltac.errors import InputError

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
    versions = tuple((what.strip(), which.strip()) for what, _, which in pairs)
    telling = tuple(pair for pair in versions if pair[0] in _TELLING)
    # Where there is no such file, Python asks the system, on some by a process of its own.
    return (("machine", platform.machine()), *(telling or [("processor", platform.processor())]))


# --- how many states go side by side through one instruction: the width of the SIMD code ---------
# Early processors with AVX-512 clocked down in wide code, so that compilers use half of it. Today's do
# not: eight are 1.3 to 1.6 times faster. The width is read off the processor, never timed: a result
# must not depend, to the last bit, on how busy the machine was.

WIDTHS = (1, 2, 4, 8)
AVX512_WIDTH = 8

INSTRUCTIONS_CACHED = 10_000
"""Instructions that a processor keeps beside it, some 100 kB of them."""

LINE = 8 * AVX512_WIDTH
"""Bytes of a line of the processor's cache, which is as wide as the widest vector of doubles."""

_AVX512 = {"avx512f", "avx512dq"}  # the registers, and double-precision logic on them


def simd_width() -> int:
    """States per SIMD instruction: `DELTAC_SIMD` (1, 2, 4 or 8) if set, else what suits the processor.

    The width is part of what compiled code is named after, so the cache keeps widths apart.

    Raises:
        InputError: any other value of `DELTAC_SIMD`.
    """
    forced = os.environ.get("DELTAC_SIMD", "").strip()
    if not forced:
        return _suited()
    if forced not in map(str, WIDTHS):
        raise InputError(f"DELTAC_SIMD={forced!r}: expected one of {', '.join(map(str, WIDTHS))}")
    return int(forced)


@cache
def _suited() -> int:
    features_here = features()
    return AVX512_WIDTH if features_here >= _AVX512 else 4 if "avx" in features_here else 2


def features() -> set[str]:
    """The instruction sets of this processor, by LLVM's names."""
    import llvmlite.binding as llvm

    return {name for name, supported in llvm.get_host_cpu_features().items() if supported}


def aligned(*shape: int) -> Array:
    """Zeros that begin where a line of the cache does: vectors of that width then lie in one, not in two."""
    size, each = math.prod(shape), np.dtype(np.float64).itemsize
    room = np.zeros(size + LINE // each)
    start = -room.ctypes.data % LINE // each
    return room[start : start + size].reshape(shape)
