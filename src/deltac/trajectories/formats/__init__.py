"""Logs in files: one module a format, the schema, mappings of other programs' columns, streaming."""

from __future__ import annotations
