"""Bringing states onto their constraints: assembly, projection, singular configurations, energy."""
