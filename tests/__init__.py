"""The tests: by package, with what they share in `systems`, `support` and `oracles`."""

from __future__ import annotations
