"""The same motion at several steps: how its errors converge, and whose they are."""

from __future__ import annotations
