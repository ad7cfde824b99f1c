from __future__ import annotations

import os

# Tests compile kernels that nobody needs again.
os.environ.setdefault("DELTAC_CACHE", "off")
