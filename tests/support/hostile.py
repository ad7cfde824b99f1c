"""Runs work on hostile input in a process of its own, with bounds on its memory and time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

MEMORY = 4 * 2**30  # of addresses: polars alone maps 1.5 GB
SECONDS = 60

READ = """
import resource, sys
import deltac.trajectories as t, numpy, polars, h5py
resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
from deltac.errors import InputError
def read(path, *more):
    try:
        run = t.read_trajectory(path, *more)
    except InputError as error:
        print("InputError", error)
    else:
        print("read", len(run), len(run.coordinates))
"""


def outcome(path: Path, code: str = "read(sys.argv[1])", **environment: str) -> str:
    """What `read` says of a file: "InputError …" or "read <rows> <coordinates>"; fails when it hangs."""
    done = subprocess.run(
        [sys.executable, "-c", READ.replace("MEMORY", str(MEMORY)) + code, str(path)],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=SECONDS,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            "POLARS_MAX_THREADS": "2",
            "OPENBLAS_NUM_THREADS": "1",
            **environment,
        },
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout
