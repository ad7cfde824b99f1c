"""From a mechanism and a state to a trajectory.

Users find the names in `deltac`. Here each is imported from its own module: equations written by hand need no
solver, and a run no ensemble.
"""

from __future__ import annotations

from deltac.calls.stubs import on_first_use

__all__, __getattr__, __dir__ = on_first_use(__name__, __file__)
