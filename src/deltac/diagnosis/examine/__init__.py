"""The whole procedure in one call: describe, check, study, recommend, audit."""

from __future__ import annotations
