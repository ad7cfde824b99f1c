"""What code prints in processes of its own: it must not depend on their hash seeds."""

from __future__ import annotations

import subprocess
import sys


def printed(code: str) -> set[str]:
    """What the code prints under two hash seeds; one element where it is the same."""
    return {
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
