"""What several test files do: compare, run commands, mark repetitions as slow."""

from __future__ import annotations
