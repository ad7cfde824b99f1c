"""Reproduce the thesis's study (figs. 4.1 to 4.10): figures and results.json in a folder, and one table.

    python benchmarks/thesis/run.py --only 4.7

The exit code is 0 if everything agrees except for known differences, which the table marks; else 1.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import thesis
from deltac.cli.output import print_sections, progress_bar
from deltac.errors import InputError
from thesis.drawing import output_folder


def main() -> int:
    """Run, draw, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--only",
        metavar="FIGURES",
        help="as 4.1,4.2; floor: inexact accelerations; rate: the rate form",
    )
    parser.add_argument("--out", type=Path, default=Path("results/thesis"), metavar="DIR")
    parser.add_argument("--thesis-axes", action="store_true", help="its panels and axes")
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="live figures on one page")
    options = parser.parse_args()
    figures = None
    if options.only is not None:
        figures = [part.strip() for part in options.only.split(",") if part.strip()]
    try:
        output_folder(options.out)
        with progress_bar() as progress:
            study = thesis.reproduce(figures, progress)
            written = thesis.write(study, options.out, thesis_axes=options.thesis_axes)
    except InputError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    if options.report is not None:
        study.report(options.report)
    print_sections(study.sections())
    print(f"figures: {options.out / 'figure_*.png'} ({len(written.figures)})")
    print(f"results: {written.results} ({len(study.results)} numbers)")
    return study.exit_code


if __name__ == "__main__":
    sys.exit(main())
