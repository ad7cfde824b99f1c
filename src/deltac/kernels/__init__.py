"""Machine code from CasADi expressions: lowering, batches, parameters, evaluators, the cache."""

from __future__ import annotations

from deltac.kernels.cache import (
    CacheInfo,
    CacheWarning,
    cache_info,
    clear_cache,
    compiled,
    prepare_heyoka,
    verify_cache,
)
from deltac.kernels.evaluators import Evaluator, compile_function, evaluator_name
from deltac.kernels.kernel import Kernel
from deltac.kernels.lowering import to_heyoka, to_mpmath, to_sympy

__all__ = [
    "CacheInfo",
    "CacheWarning",
    "Evaluator",
    "Kernel",
    "cache_info",
    "clear_cache",
    "compile_function",
    "evaluator_name",
    "compiled",
    "prepare_heyoka",
    "to_heyoka",
    "to_mpmath",
    "to_sympy",
    "verify_cache",
]
