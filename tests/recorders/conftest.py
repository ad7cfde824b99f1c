from __future__ import annotations

import os

# Kernels that nobody needs again.
os.environ.setdefault("DELTAC_CACHE", "off")
