"""The benchmarks are scripts: their folder goes last on the path, where it is there at all."""

from __future__ import annotations

import sys
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

if BENCHMARKS.exists() and str(BENCHMARKS) not in sys.path:
    sys.path.append(str(BENCHMARKS))
