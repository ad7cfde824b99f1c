"""Equations of motion in rate form: at chosen states, and at the samples of a log."""
