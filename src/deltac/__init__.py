"""deltac: energy testing functions for multibody simulations.

The public names are loaded on first use, so that ``import deltac`` stays light. They are listed
once, in ``__init__.pyi``: type checkers read that stub, and so does this module. What is done often
has a name here; the parts that mechanisms are made of are in `deltac.bodies`, `deltac.joints`,
`deltac.forces`, `deltac.constraints`, `deltac.events` and `deltac.shapes`; options of solvers
in `deltac.solvers`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from deltac.calls.services import provide
from deltac.calls.stubs import listed

__version__ = "1.0.0"

#: public name -> the module that defines it
_PUBLIC = listed(__file__)

__all__ = sorted(_PUBLIC)

provide(
    {
        "MonitoredEnv": "deltac.recorders.gymnasium_monitor",
        "MujocoMonitor": "deltac.recorders.mujoco_monitor",
        "evaluate": "deltac.analysis.evaluate",
        "figure": "deltac.report.plots",
        "html_of": "deltac.report.page",
        "kinematics": "deltac.analysis.kinematics",
        "to_columns": "deltac.trajectories.formats.schema",
        "trajectory_of_states": "deltac.recorders.state_vectors",
        "write_report": "deltac.report.page",
        "write_summary": "deltac.fleets.summary",
        "write_trajectory": "deltac.trajectories.formats.files",
    }
)


def __getattr__(name: str) -> Any:
    """Load a public name on its first use (PEP 562)."""
    if name not in _PUBLIC:
        message = f"module {__name__!r} has no attribute {name!r}"
        if name[:1] != "_":  # what Python itself looks for
            from deltac.errors import closest

            message += closest(name, _PUBLIC).partition("; known")[0]
        raise AttributeError(message)
    home = _PUBLIC[name]
    from deltac.calls.interrupts import interruptible

    with interruptible():  # compiled packages may drop what is raised while they are loaded
        if home == __name__:
            return import_module(f"{home}.{name}")
        value = globals()[name] = getattr(import_module(home), name)
    return value


def __dir__() -> list[str]:
    return sorted({*_PUBLIC, "__version__", "__doc__"})
