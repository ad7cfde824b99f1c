"""Functional Mock-up Units as equations of motion: FMI 2 and 3, model exchange, through FMPy.

A unit for model exchange gives ẋ(t, x). Which of its states are coordinates, and which speed belongs to each,
is found from what it gives: the rate of a coordinate is the value of its speed.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import tempfile
import weakref
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deltac.arrays import NEWTON_STEPS, Array
from deltac.calls.arguments import checked
from deltac.errors import FileError, InputError, SourceError, requirement
from deltac.foreign.limits import Limits
from deltac.trajectories.formats.files import naming


@checked
def load_fmu(path: str | Path, coordinates: Sequence[str] = ()) -> Callable[[float, Array], Array]:
    """The equations of motion that an FMU has, as a function of (t, y) with y = (coordinates, speeds).

    Its inputs are what they start with, its parameters as well. `coordinates` are names to order the unit's
    coordinates by, where they have these (or end with them after a dot); else they stay in its order.

    The unit is a shared library of whoever made it: it is loaded into this process.

    Raises:
        InputError: no such file or no FMU; one for co-simulation alone; states that are no coordinates and
            speeds; FMPy is not installed.
    """
    file = Path(path)
    with requirement("FMUs are read with FMPy: pip install 'deltac[fmi]'"):
        import fmpy
    if not os.path.isfile(file):
        raise FileError(f"{path}: no such file")
    try:
        with zipfile.ZipFile(file) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        with naming(path):
            Limits.current().check_unpacked(size, file.stat().st_size)
        described = fmpy.read_model_description(str(file), validate=False)
    except InputError:
        raise
    except (zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
        raise FileError(f"{path}: is no FMU: {error}") from error
    except Exception as error:  # FMPy raises plain exceptions for what it cannot read
        raise FileError(f"{path}: its model description cannot be read: {error}") from error
    version = str(described.fmiVersion)
    if described.modelExchange is None or version.startswith("1."):
        kind = " for co-simulation" if described.modelExchange is None else ""
        raise SourceError(
            f"{path}: an FMU of FMI {version}{kind}; expected FMI 2 or 3 for model exchange, which gives "
            "rates at any state: export it so"
        )
    names = [entry.variable.derivative.name for entry in described.derivatives]
    unit = _unit(fmpy, file, described, version.startswith("3."), len(names))
    order = _order(unit, names, coordinates, str(path))
    back = np.argsort(order)

    def rates(t: Any, y: Any) -> Array:
        """ẏ of the unit's coordinates, then speeds."""
        return np.asarray(unit(float(t), np.asarray(y, dtype=np.float64)[back])[order])

    rates.__name__ = file.name
    return rates


def _unit(
    fmpy: Any, file: Path, described: Any, third: bool, n: int
) -> Callable[[float, Array], Array]:
    """ẋ(t, x) of an instance of the unit; its library and files go with the function."""
    from fmpy.simulation import instantiate_fmu

    folder = tempfile.mkdtemp(prefix="deltac-fmu-")
    try:
        fmpy.extract(str(file), folder)
        model = instantiate_fmu(folder, described, fmi_type="ModelExchange")
        if third:
            settle, evaluate = model.updateDiscreteStates, model.getContinuousStateDerivatives
        else:
            model.setupExperiment(startTime=0.0)
            settle, evaluate = model.newDiscreteStates, model.getDerivatives
        model.enterInitializationMode()
        model.exitInitializationMode()
        for _ in range(NEWTON_STEPS):
            if not settle()[0]:
                break
        model.enterContinuousTimeMode()
    except Exception as error:  # FMPy, and what the unit says by it
        shutil.rmtree(folder, ignore_errors=True)
        raise SourceError(f"{file}: the FMU does not start: {error}") from error
    x, rates = (ctypes.c_double * n)(), (ctypes.c_double * n)()

    def called(t: float, state: Array) -> Array:
        x[:] = state.tolist()
        try:
            model.setTime(t)
            model.setContinuousStates(x, n)
            evaluate(rates, n)
        except Exception as error:  # a status that is no success
            raise SourceError(f"{file}: the FMU gives no rates: {error}") from error
        return np.array(rates)

    weakref.finalize(called, _closed, model, folder)
    return called


def _closed(model: Any, folder: str) -> None:
    try:
        model.terminate()
        model.freeInstance()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _order(
    unit: Callable[[float, Array], Array],
    names: list[str],
    rates: Sequence[str],
    path: str,
) -> list[int]:
    """The places of the coordinates, then of their speeds, among the unit's states."""
    n = len(names)
    x = np.random.default_rng(0).uniform(0.3, 1.3, n)
    matches = [np.flatnonzero(x == rate) for rate in unit(0.0, x)]
    pairs = [(i, int(places[0])) for i, places in enumerate(matches) if len(places) == 1]
    if 2 * len(pairs) != n or len({k for pair in pairs for k in pair}) != n:
        raise SourceError(
            f"{path}: its {n} states ({', '.join(names)}) are not coordinates and their rates, one for each; "
            "expected states q and u with q̇ = u, as of minimal coordinates"
        )
    ends = {names[i].rpartition(".")[2]: (i, j) for i, j in pairs} | {
        names[i]: (i, j) for i, j in pairs
    }
    if rates and all(name in ends for name in rates) and len(rates) == len(pairs):
        pairs = [ends[name] for name in rates]
    return [i for i, _ in pairs] + [j for _, j in pairs]
