"""Edits out: what each expression must be, and what could be written to make it so."""
