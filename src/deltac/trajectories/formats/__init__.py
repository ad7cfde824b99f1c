"""Logs in files: one module a format, the schema, mappings of other programs' columns, streaming."""
