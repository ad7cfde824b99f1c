"""Mechanics as matrix algebra on CasADi: the recursions, the terms of the energy theorem, the textbook."""
