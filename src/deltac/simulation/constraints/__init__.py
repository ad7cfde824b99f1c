"""Bringing states onto their constraints: assembly, projection, singular configurations, energy."""

from __future__ import annotations
