"""Motions known at samples: what lies between them, and integrals along them with an error bar."""
