"""One log against a model: where the energy went, and what is wrong."""

from __future__ import annotations
