"""Fuzzing of deltac's own parsers: `targets` and a `corpus` to start from, `python -m tests.fuzz` to run."""
