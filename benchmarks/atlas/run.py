"""Run the models of installed packages in every simulator by every integrator, and judge every run.

    python benchmarks/atlas/run.py benchmarks/atlas/plan.toml --out RESULTS
    python benchmarks/atlas/run.py PLAN --only ADDRESS --report FILE.html

Results already in the folder are reused; `deltac sweep --status RESULTS` shows the progress.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from atlas.fleet import atlas, plan_atlas
from deltac.cli.sweep import fleet_progress


def main() -> int:
    """Its exit code is that of the fleet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("plan", type=Path)
    parser.add_argument(
        "--out", type=Path, help="folder of the results; by default the plan's name with .atlas"
    )
    parser.add_argument(
        "--only", metavar="ADDRESS", help="one run in this process: its row, its page"
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE.html", help="with --only: the page of the run"
    )
    parser.add_argument(
        "--retry-failed", action="store_true", help="try again what was set aside before"
    )
    parser.add_argument("--workers", type=int)
    parser.add_argument("--retries", type=int)
    parser.add_argument("--time-limit", type=float, help="seconds of a run and its audit")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler")
    options = vars(parser.parse_args())
    path, out, only, page = (options.pop(name) for name in ("plan", "out", "only", "report"))
    if only is None:
        with fleet_progress("runs", len(plan_atlas(path).addresses)) as progress:
            fleet = atlas(path, out, progress=progress, **options)
        print(fleet)
        return fleet.exit_code
    plan = plan_atlas(path)
    if page is not None:
        plan.write_case(only, page)
    piece = plan.piece_at(only)
    (row,) = piece.table(piece()).to_dicts()
    print(json.dumps(row, indent=1, default=str))
    return 0


if __name__ == "__main__":
    sys.exit(main())
