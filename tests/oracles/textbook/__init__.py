"""The theory in dense matrices and plain NumPy: slow, readable, and independent of the recursions."""
