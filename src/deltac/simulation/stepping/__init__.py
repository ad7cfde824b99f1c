"""Steps in time: one protocol, one loop, one file for each family of solvers."""
