"""Machine code from CasADi expressions: lowering, batches, parameters, evaluators, the cache."""

from __future__ import annotations

from deltac.kernels.cache import (
    CacheInfo,
    CacheWarning,
    cache_folder,
    cache_info,
    cache_wanted,
    clear_cache,
    compiled,
    prepare_heyoka,
    verify_cache,
)
from deltac.kernels.evaluators import Evaluator, compile_function, evaluator_name
from deltac.kernels.kernel import Kernel
from deltac.kernels.lowering import to_heyoka, to_mpmath, to_sympy
from deltac.kernels.parallel import cores
from deltac.kernels.rows import compiled_rows
from deltac.kernels.simd import AVX512_WIDTH

__all__ = [
    "AVX512_WIDTH",
    "CacheInfo",
    "CacheWarning",
    "Evaluator",
    "Kernel",
    "cache_folder",
    "cache_info",
    "cache_wanted",
    "clear_cache",
    "compile_function",
    "cores",
    "evaluator_name",
    "compiled",
    "compiled_rows",
    "prepare_heyoka",
    "to_heyoka",
    "to_mpmath",
    "to_sympy",
    "verify_cache",
]
