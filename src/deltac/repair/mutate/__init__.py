"""Mistakes made on purpose: which tests see them."""
