"""How many states go side by side through one instruction: the width of the SIMD code.

heyoka recommends four doubles on processors with AVX-512, since early ones clocked down in wide code.
Today's do not: eight are 1.3 to 1.6 times faster. The width is read off the processor, never timed: a
result must not depend, to the last bit, on how busy the machine was.
"""

from __future__ import annotations

import os
from functools import cache

from deltac.errors import InputError
from deltac.kernels.processor import flags

WIDTHS = (1, 2, 4, 8)
AVX512_WIDTH = 8
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
    import heyoka as hy

    recommended = int(hy.recommended_simd_size())
    return max(recommended, AVX512_WIDTH) if flags() >= _AVX512 else recommended
