"""The same motion at several steps: how its errors converge, and whose they are."""
