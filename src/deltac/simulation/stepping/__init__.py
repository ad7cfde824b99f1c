"""Steps in time: one protocol, one loop, one file for each family of solvers."""

from __future__ import annotations
