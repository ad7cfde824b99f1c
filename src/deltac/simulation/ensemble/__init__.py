"""Many runs of one mechanism, side by side."""

from __future__ import annotations
