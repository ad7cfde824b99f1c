"""What a user waits for the audit of a run of MuJoCo, processor time: the first of a process, and the next.

    python benchmarks/audit_wait.py                      # the 27-dof humanoid of `humanoid.py`
    python benchmarks/audit_wait.py humanoid_CMU         # a model of dm_control's suite, or a path
    python benchmarks/audit_wait.py humanoid --contacts

The model falls for 1.5 s at its own step by RK4, every row recorded, from small random speeds.
"""

from __future__ import annotations

import argparse
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import humanoid
import mujoco
import numpy as np

import deltac as dc


def model_of(name: str) -> Any:
    """A model by its path or its name in dm_control's suite; the humanoid of the benchmarks by none."""
    if not name:
        return humanoid.model()
    spec = find_spec("dm_control")
    suite = Path(spec.origin or "").parent / "suite" if spec else Path()
    path = Path(name) if Path(name).is_file() else suite / f"{name}.xml"
    return mujoco.MjModel.from_xml_path(str(path))


def main() -> None:
    """Record the run, and audit it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", nargs="?", default="")
    parser.add_argument("--contacts", action="store_true", help="with the model's contacts")
    parser.add_argument("--times", type=int, default=3)
    options = parser.parse_args()
    model = model_of(options.model)
    if not options.contacts:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    data.qvel[:] = 0.1 * np.random.default_rng(0).standard_normal(model.nv)
    run = dc.run_mujoco(model, 1.5, data=data, integrator="rk4")
    print(f"{model.nv} dof, {len(run)} rows, {len(run.forces)} forces")
    for _ in range(options.times):
        start = time.process_time()
        audit = dc.audit(model, run)
        print(f"  audit {time.process_time() - start:.2f} s: {audit}")


if __name__ == "__main__":
    main()
