from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

# Tests compile hundreds of kernels that nobody needs again.
os.environ.setdefault("DELTAC_CACHE", "off")


@pytest.fixture(autouse=True, scope="session")
def one_step_per_call() -> Iterator[None]:
    """Unrolled steps take long to compile, for runs as short as these; the tests of fusing unroll."""
    from deltac.simulation import fixed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fixed, "MOST_STEPS_PER_CALL", 1)
        yield
