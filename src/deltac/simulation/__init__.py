"""From a mechanism and a state to a trajectory.

Users find the names in `deltac`. Here each is imported from its own module: equations written by hand need no
solver, and a run no ensemble.
"""
