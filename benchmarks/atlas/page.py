"""The page of the atlas: its tables in docs/data/atlas and the data of its interactive table.

    python benchmarks/atlas/page.py RESULTS

RESULTS is the folder of `benchmarks/atlas/run.py benchmarks/atlas/plan.toml --out RESULTS`, complete or not.
"""

from __future__ import annotations

import csv
import json
import re
import statistics
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from atlas.experiments import SIMULATORS
from deltac.fleets.result import fleet_status

DOCS = Path(__file__).resolve().parents[2] / "docs"
VERDICTS = (
    "consistent", "integration-error", "equation-error", "unresolved", "blew up", "failed"
)  # fmt: skip
SIMULATOR = {
    "mujoco": "MuJoCo", "drake": "Drake", "pybullet": "PyBullet", "pinocchio": "Pinocchio",
    "exudyn": "Exudyn", "deltac": "deltac",
}  # fmt: skip

WRONG = 0.5
"""A run whose |ΔC| exceeds this share of the energy that the system has blew up, as one that ended early."""

ROUNDING = 1e-11
"""Energy errors below this share of the energy have no order: they are digits."""

BARS = 10.0
"""Energy errors within so many of their error bars have no order either."""


def verdict(run: dict[str, Any]) -> str:
    """That of the audit; of runs that blew up, this."""
    message = run["message"] or ""
    if run["verdict"] == "failed":
        diverged = any(word in message for word in ("blew up", "first step", "is nan", "is inf"))
        return "blew up" if diverged else "failed"
    early = run["lasted"] < run["duration"] - 1.5 * run["step"]
    if run["verdict"] == "unresolved" and (early or run["relative"] > WRONG):
        return "blew up"
    return str(run["verdict"])


def nominal(solver: str) -> int:
    """The order of an integrator, as its simulator states it."""
    simulator, _, name = solver.partition(":")
    return SIMULATORS[simulator].orders[name]


def why(run: dict[str, Any]) -> str:
    """What a run's verdict rests on: causes, or what would decide, or why it could not be made."""
    if run["causes"]:
        return str(run["causes"])
    if run["verdict"] == "failed":
        text = str(run["message"]).replace(str(Path.cwd()), "")
        return re.sub(r"(/\S+)?/site-packages/(cmeel.prefix/share/)?", "", text)[:200]
    if run["verdict"] == "unresolved":
        undecided = re.search(
            r"\[F-UNDECIDED\]: (.*?)\. ", " ".join((run["details"] or "").split())
        )
        return undecided[1] if undecided else ""
    return ""


def order(runs: Sequence[dict[str, Any]]) -> float | None:
    """Observed order of the energy error over the runs, coarsest first; None where it has none."""
    errors = [run["energy_error"] for run in runs]
    if len(runs) < 2 or None in errors or any(verdict(run) == "blew up" for run in runs):
        return None
    floors = [max(BARS * run["error_bar"], ROUNDING * run["energy"]) for run in runs]
    if any(error <= floor for error, floor in zip(errors, floors)):
        return None
    ratio = errors[0] / errors[-1]
    return float(np.log(ratio) / np.log(runs[0]["step"] / runs[-1]["step"]))


def entries(rows: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """One for each model, integrator and motion: runs at all steps together, coarsest first."""
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["model"], row["solver"], row["motion"]), []).append(row)
    for (model, solver, motion), runs in groups.items():
        runs.sort(key=lambda run: -run["factor"])
        middle = min(runs, key=lambda run: abs(np.log(run["factor"])))
        good = [run["step"] for run in runs if (run["relative"] or 0.0) <= 1e-3 and run["energy"]]
        exchanged = middle["exchanged"]
        yield {
            "model": model,
            "solver": solver,
            "motion": motion,
            "verdict": verdict(middle),
            "address": middle["address"],
            "step": middle["step"],
            "runs": runs,
            "speeds": middle["speeds"],
            "per_joule": middle["energy_error"] / exchanged if exchanged else None,
            "order": order(runs),
            "largest": max(good, default=None),
            "why": why(middle),
        }


Table = list[Sequence[Any]]
"""A head and its rows."""


def by_integrator(every: Sequence[dict[str, Any]]) -> Table:
    """Verdicts of the runs, and what an integrator costs at the models' own step."""
    rows = []
    for solver in sorted({entry["solver"] for entry in every}):
        own = [entry for entry in every if entry["solver"] == solver]
        runs = [run for entry in own for run in entry["runs"]]
        counts = Counter(map(verdict, runs))
        orders = [entry["order"] for entry in own if entry["order"] is not None]
        costs = [entry["per_joule"] for entry in own if entry["per_joule"] is not None]
        rows.append(
            (
                f"`{solver}`",
                len({entry["model"] for entry in own}),
                len(runs),
                *(counts[v] or "" for v in VERDICTS),
                f"{statistics.median(orders):.2f} ({nominal(solver)})" if orders else "",
                f"{statistics.median(costs):.1e}" if costs else "",
            )
        )
    head = ("integrator", "models", "runs", *VERDICTS, "order (nominal)", "error per joule")
    return [head, *rows]


def by_simulator(every: Sequence[dict[str, Any]]) -> Table:
    """Verdicts of all runs by simulator, with shares of those that were judged."""
    rows = []
    for key, name in [*SIMULATOR.items(), ("", "all")]:
        own = [entry for entry in every if entry["solver"].startswith(key)]
        runs = [run for entry in own for run in entry["runs"]]
        counts = Counter(map(verdict, runs))
        models = len({entry["model"] for entry in own})
        share = 100.0 * counts["unresolved"] / max(len(runs), 1)
        rows.append(
            (name, models, len(runs), *(counts[v] or "" for v in VERDICTS), f"{share:.1f} %")
        )
    return [("simulator", "models", "runs", *VERDICTS, "share unresolved"), *rows]


def by_package(every: Sequence[dict[str, Any]], refused: Sequence[dict[str, Any]]) -> Table:
    """How many models a package ships, and what came of them."""
    names = Counter(entry["model"].split("/")[0] for entry in refused)
    models: dict[str, set[str]] = {}
    for entry in every:
        models.setdefault(entry["model"].split("/")[0], set()).add(entry["model"])
    rows = []
    for package in sorted({*names, *models}):
        own = [e for e in every if e["model"].split("/")[0] == package]
        runs = [run for entry in own for run in entry["runs"]]
        counts = Counter(map(verdict, runs))
        rows.append(
            (package, len(models.get(package, ())), names[package], len(runs),
             *(counts[v] or "" for v in VERDICTS))
        )  # fmt: skip
    return [("package", "models run", "not run", "runs", *VERDICTS), *rows]


def below_nominal(every: Sequence[dict[str, Any]]) -> Table:
    """Where the observed order is less than the nominal one by more than a third."""
    rows = [
        (
            f"`{e['model']}`",
            f"`{e['solver']}`",
            e["motion"],
            f"{e['order']:.2f} ({nominal(e['solver'])})",
        )
        for e in every
        if e["order"] is not None and e["order"] < nominal(e["solver"]) - 1 / 3
    ]
    return [("model", "integrator", "motion", "order (nominal)"), *rows]


def data(every: Sequence[dict[str, Any]]) -> str:
    """What the browser sorts: names and sentences once, and a list of numbers for each entry."""
    names = {key: sorted({e[key] for e in every}) for key in ("model", "solver", "motion", "why")}
    places = {key: {name: k for k, name in enumerate(own)} for key, own in names.items()}

    def short(value: float | None, digits: int = 3) -> float | None:
        return None if value is None else float(f"{value:.{digits}g}")

    rows = [
        [
            *(places[key][e[key]] for key in ("model", "solver", "motion")),
            VERDICTS.index(e["verdict"]),
            e["speeds"] and int(e["speeds"]),
            short(e["step"]),
            short(e["per_joule"], 2),
            short(e["order"]),
            short(e["largest"]),
            places["why"][e["why"]],
            e["address"][:8],
        ]
        for e in every
    ]
    pictures = json.loads((DOCS / "assets" / "atlas-pictures.json").read_text())
    return json.dumps(
        {**names, "verdict": VERDICTS, "pictures": pictures, "rows": rows},
        ensure_ascii=False,
        separators=(",", ":"),
    )


def main() -> None:
    """Write the data, the tables, and the count between the markers of the page."""
    fleet = fleet_status(Path(sys.argv[1]))
    frame = fleet.frame
    rows = [row for row in frame.iter_rows(named=True)]
    refused = [row for row in rows if row["solver"] is None]
    every = list(entries(row for row in rows if row["solver"] is not None))
    (DOCS / "assets" / "atlas-data.js").write_text(f"window.ATLAS={data(every)}\n")
    planned = fleet.total - len(refused)
    runs = sum(len(entry["runs"]) for entry in every)
    models = len({entry["model"] for entry in every})
    audits, motions = (
        [row[name] for row in rows if row[name] is not None] for name in ("seconds", "run_seconds")
    )
    builds = Counter(row["build"] for row in rows if row["build"])
    count = (
        f"{runs} of {planned} planned runs, of {models} models; {len(refused)} models were not run. "
        f"Processor time: {sum(motions):.0f} s for the runs, {sum(audits):.0f} s for the audits, "
        f"{statistics.median(map(sum, zip(motions, audits, strict=True))):.2f} s in the median of both. "
        f"Versions of deltac: {', '.join(f'{name} ({n} runs)' for name, n in builds.most_common())}."
    )
    tables = {
        "simulators": by_simulator(every),
        "integrators": by_integrator(every),
        "packages": by_package(every, refused),
        "orders": below_nominal(every),
        "refused": [
            ("reason", "models"),
            *Counter(
                re.sub(
                    r"^\d+ speeds, .*",
                    "too large for this atlas",
                    re.sub(r"^\S+: ", "", row["message"]),
                )
                .split(": ")[0][:70]
                .replace("|", "/")
                for row in refused
            ).most_common(12),
        ],
    }
    for name, rows_of_table in tables.items():
        with (DOCS / "data" / "atlas" / f"{name}.csv").open(
            "w", encoding="utf-8", newline=""
        ) as file:
            csv.writer(file, lineterminator="\n").writerows(rows_of_table)
    page = DOCS / "atlas.md"
    marked = r"(<!-- count -->\n)(.*?)(<!-- end -->)"
    page.write_text(
        re.sub(marked, lambda m: f"{m[1]}{count}\n{m[3]}", page.read_text(), flags=re.S)
    )
    print(count)


if __name__ == "__main__":
    main()
