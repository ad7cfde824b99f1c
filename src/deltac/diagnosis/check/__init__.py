"""Equations of motion written by hand against a mechanism: right or wrong, and where."""

from __future__ import annotations
