"""Equations of motion written by hand against a mechanism: right or wrong, and where."""
