"""Motions and numbers by other means: closed forms, independent derivations, other libraries."""

from __future__ import annotations
