"""The cheapest solver and step that keep a tolerance, tried and verified."""

from __future__ import annotations
