"""The judge's bench: does `audit` tell integrator, equations and log apart? `make bench-judge`.

    make bench-judge [ARGS="--seed 1 --right 100 --wrong 100"]
    make bench-judge ARGS="--seed 1 --case wrong:17"      # one case again, with all that was said
    make bench-judge ARGS="--coverage 2000"               # of the 95 % bars of ΔC, on logs with known truth
    make bench-judge ARGS="--suite"                       # dm_control's models by RK4, recorded by run_mujoco

Machines, bodies, simulators and the planting of faults in them are those of `benchmarks/foreign`, imported.
Seeds 0 to 99 are for tuning; the published tables are of seeds from 1000 on, looked at once.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import traceback
import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

Row = dict[str, Any]
Names = tuple[tuple[str, ...], tuple[str, ...]]

KINDS = ("consistent", "integration-error", "unresolved", "equation-error")
CERTAIN = float(np.log(99.0))
"""Log odds at which the oracle counts as seeing a fault: 99 : 1."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--right", type=int, default=100)
    parser.add_argument("--wrong", type=int, default=100)
    parser.add_argument("--only", default="", help="classes whose name has this in it")
    parser.add_argument("--case", default="", help="right:N or wrong:N")
    parser.add_argument("--coverage", type=int, default=0, metavar="N")
    parser.add_argument("--suite", action="store_true")
    parser.add_argument(
        "--no-truth",
        action="store_true",
        help="without joules and oracle, which take most of the time",
    )
    parser.add_argument("--out", type=Path, default=Path("results/judge.jsonl"))
    parser.add_argument("--table", action="store_true", help="only the tables of the file --out")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.coverage:
        return print(coverage(options.seed, options.coverage))
    if options.suite:
        return print(suite())
    with_truth = not options.no_truth
    if options.case:
        truth, _, number = options.case.partition(":")
        one = prepared(options.seed, int(number), truth, options.only, with_truth)
        return print(json.dumps(one and judged(one, True), indent=1))
    if not options.table:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        tasks = [
            (k, truth)
            for k in range(max(options.right, options.wrong))
            for truth in ("right", "wrong")
            if k < getattr(options, truth)
        ]
        with options.out.open("w", encoding="utf-8") as file:
            for number, truth in tasks:
                one = prepared(options.seed, number, truth, options.only, with_truth)
                if one is not None:
                    file.write(json.dumps(judged(one)) + "\n")
                    file.flush()
    rows = [json.loads(line) for line in options.out.read_text("utf-8").splitlines()]
    print(tables(rows))


@dataclass(frozen=True)
class Prepared:
    """A log with its model, the causes that name what is wrong, and the true columns of its row.

    `joules` are the true ones between two times: of what went into a filter some rows are not told.
    """

    row: Row
    model: Any
    log: Any
    kinds: Names
    joules: Callable[[float, float], Row] = lambda first, last: {}


def prepared(
    seed: int, number: int, truth: str, only: str = "", with_truth: bool = True
) -> Prepared | None:
    """The case of a seed and number; None for a motion that ran away, or a fault that no motion shows."""
    from judge.cases import case
    from judge.habits import KNOWN

    try:
        made = case(seed, number, truth, only)
    except (ValueError, np.linalg.LinAlgError) as error:
        print(f"{truth}:{number} not made: {error}", file=sys.stderr)
        return None
    if made is None:
        return None
    run, rows = made.run, made.kept
    row: Row = {
        "seed": seed,
        "case": f"{truth}:{number}",
        "only": only,
        "truth": truth,
        "system": run.system,
        "scheme": run.scheme,
        "h": run.h,
        "habit": made.habit,
        "notes": made.notes,
        "fault": run.fault,
        "size": run.size,
        "rows": len(rows.t),
        "nu": run.rows.u.shape[1],
    }
    made_up = Prepared(row, run.model, made.log, run.kinds)
    if not with_truth:
        return made_up
    share = run.joules()
    if share is not None:
        row["effect"] = share.effect
        if run.fault and share.effect is not None and share.effect < 1e-14:
            return None
        own = run.rows if made.habit == "recorded" else rows

        def joules(first: float, last: float) -> Row:
            a, b = (int(own.index[np.argmin(np.abs(own.t - t))]) for t in (first, last))
            true: Row = {}
            for name in ("integrator", "mistake"):
                curve, slack = getattr(share, name), getattr(share, f"{name}_slack")
                true[f"true_{name}"] = float(curve[b] - curve[a])
                true[f"{name}_slack"] = float(slack[b] + slack[a])
                true[f"largest_{name}"] = float(np.abs(curve[a : b + 1] - curve[a]).max())
            return true

        made_up = replace(made_up, joules=joules)
    if run.oracle is not None and made.habit in KNOWN and rows.sigma is not None:
        odds = run.oracle(np.hstack([rows.q, rows.u]), rows.index, rows.sigma)
        row["oracle"] = {k: round(float(v), 2) for k, v in odds.items()}
    return made_up


def judged(case: Prepared, verbose: bool = False) -> Row:
    """What `audit` says of a case, beside what is true."""
    import deltac as dc

    row = dict(case.row)
    begun = time.process_time()
    try:
        audit = dc.audit(case.model, case.log)
    except dc.DeltacError as error:
        return {**row, "verdict": "refused", "message": str(error)[:300], "cpu": 0.0}
    except Exception as error:  # noqa: BLE001, what crashes is a result of the bench
        if verbose:
            traceback.print_exc()
        where = traceback.extract_tb(error.__traceback__)[-1]
        message = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        return {**row, "verdict": "crashed", "message": message[:300], "cpu": 0.0}
    cpu = time.process_time() - begun
    row |= {"verdict": audit.verdict.kind, "cpu": cpu, **_told(audit, case.kinds)}
    row |= case.joules(float(audit.run.t[0]), float(audit.run.t[-1]))
    row["findings"] = [(f.kind, f.weight, f.element) for f in audit.findings]
    if verbose:
        row["evidence"], row["explain"] = list(audit.verdict.evidence), _text(audit)
    return row


def _text(audit: Any) -> str:
    explain = getattr(audit, "explain", None)
    return str(explain() if callable(explain) else "")


def _told(audit: Any, names: Names) -> Row:
    """Attribution, causes and odds of an audit, as far as it has them."""
    row: Row = {"tolerance": float(audit.tolerance * audit.reference_energy)}
    attribution = getattr(audit, "attribution", None)
    if attribution is not None:
        for name in ("integrator", "equations", "log"):
            part = getattr(attribution, name)
            row[f"told_{name}"], row[f"told_{name}_error"] = float(part.energy), float(part.error)
        row["delta_c"] = float(np.atleast_1d(audit.energy_error)[-1])
    odds = getattr(audit, "odds", None)
    if odds is not None:
        row["odds"] = {k: float(v) for k, v in dict(odds).items()}
    causes = getattr(audit, "causes", None)
    if not causes:
        causes = [f for f in audit.findings if f.weight == "cause"]
    listed = [(cause.kind, cause.element) for cause in causes]
    row["causes"] = listed[:5]
    strength = [getattr(c, "log_odds", getattr(c, "odds", None)) for c in causes][:5]
    row["cause_odds"] = [None if s is None else float(s) for s in strength]
    ranks = [k for k, one in enumerate(listed) if _names(names, *one)]
    row["rank"] = ranks[0] if ranks else None
    equals = {(f.kind, f.element): f.equals for f in audit.findings}
    first = [*listed[:1], *(one for cause in listed[:1] for one in equals.get(cause, ()))]
    row["first"] = any(_names(names, *one) for one in first)
    ranks = [k for k, (kind, _) in enumerate(listed) if _names(names, kind, "", True)]
    row["kind_rank"] = ranks[0] if ranks else None
    row["nameable"] = bool(names[0])
    return row


def _names(names: Names, kind: str, element: str, any_element: bool = False) -> bool:
    """Whether a cause is the fault that was planted; kinds of geometry by the words in them."""
    kinds, elements = names
    fits = kind in kinds or any(w in kind.split("-") for w in kinds if "-" not in w)
    return fits and (
        any_element
        or not elements
        or any(e and e in str(element).replace(".", " ").split() or e == element for e in elements)
    )


# --- tables -------------------------------------------------------------------------------------


def seen(row: Row) -> bool:
    """Whether a mistake was told: by the verdict, or as real though small."""
    return row["verdict"] == "equation-error" or any(
        f[0] == "small-but-real" for f in row.get("findings", ())
    )


def blamed(row: Row) -> bool | None:
    """Whether the integrator was blamed though its joules are within the tolerance; None: not known."""
    if (
        row["verdict"] != "integration-error"
        or "largest_integrator" not in row
        or not np.isfinite(row["tolerance"])
    ):
        return None
    return bool(row["largest_integrator"] + row["integrator_slack"] < row["tolerance"])


def oracle_sees(row: Row) -> bool | None:
    """Whether the oracle is certain of the fault; None where there is none."""
    odds = row.get("oracle") or {}
    return None if row["fault"] not in odds else bool(odds[row["fault"]] > CERTAIN)


def covered(row: Row, name: str) -> bool | None:
    """Whether told and true joules agree within two told errors, the slack of the truth and its rounding."""
    told = {"integrator": "told_integrator", "mistake": "told_equations"}[name]
    if told not in row or f"true_{name}" not in row:
        return None
    rounding = 1e-11 * max(abs(row.get("tolerance") or 0) * 1e3, 1e-3)
    bound = 2 * row[f"{told}_error"] + row[f"{name}_slack"] + rounding
    return bool(abs(row[told] - row[f"true_{name}"]) <= bound)


def adds_up(row: Row) -> bool | None:
    """Whether the three shares are ΔC at the end, within their errors."""
    if "delta_c" not in row or "told_log" not in row:
        return None
    parts = ("integrator", "equations", "log")
    errors = np.sqrt(sum(row[f"told_{p}_error"] ** 2 for p in parts))
    gap = abs(sum(row[f"told_{p}"] for p in parts) - row["delta_c"])
    return bool(gap <= 2 * errors + 1e-9 * max(abs(row["delta_c"]), 1.0))


def share(rows: Sequence[Row], test: Callable[[Row], bool | None]) -> str:
    made = [x for x in map(test, rows) if x is not None]
    return f"{sum(made)}/{len(made)}" if made else "–"


def tables(rows: list[Row]) -> str:
    """All tables, as Markdown."""
    rows = list({(r["seed"], r["case"], r["only"]): r for r in rows}.values())
    return "\n\n".join(
        [
            *(_rates(rows, by) for by in ("system", "habit", "scheme")),
            _wrong_sizes(rows),
            _reliability(rows),
            _cost(rows),
            _failures(rows),
        ]
    )


def _rates(rows: list[Row], by: str) -> str:
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        groups[row[by].partition(":")[0]].append(row)
    lines = [
        f"| {by} | right | accused | small | unresolved | blamed wrongly | refused, crashed | wrong | seen "
        "| oracle | seen of oracle's | "
        "first | or told as equal | in three | kind | integrator ±2σ | mistake ±2σ | adds up |",
        "|---|" + "--:|" * 17,
    ]
    for name, some in [*sorted(groups.items()), ("**all**", rows)]:
        right, wrong = ([r for r in some if r["truth"] == t] for t in ("right", "wrong"))
        judged = [r for r in wrong if seen(r) and r.get("nameable")]
        cells = [
            len(right),
            sum(r["verdict"] == "equation-error" for r in right),
            sum(seen(r) and r["verdict"] != "equation-error" for r in right),
            sum(r["verdict"] == "unresolved" for r in right),
            share(right + wrong, blamed),
            sum(r["verdict"] in ("refused", "crashed") for r in some),
            len(wrong),
            sum(map(seen, wrong)),
            share(wrong, oracle_sees),
            share([r for r in wrong if oracle_sees(r)], seen),
            share(judged, lambda r: r["rank"] == 0),
            share(judged, lambda r: r.get("first")),
            share(judged, lambda r: r["rank"] is not None and r["rank"] < 3),
            share(judged, lambda r: r["kind_rank"] == 0),
            share(some, lambda r: covered(r, "integrator")),
            share(some, lambda r: covered(r, "mistake")),
            share(some, adds_up),
        ]
        lines.append(f"| {name} | " + " | ".join(str(c) if c != 0 else "" for c in cells) + " |")
    return "\n".join(lines)


def _wrong_sizes(rows: list[Row]) -> str:
    """Wrong ones by their true joules beside the tolerance."""
    lines = [
        "| true joules of the mistake / tolerance | wrong | seen | called equation-error | unresolved |",
        "|---|--:|--:|--:|--:|",
    ]
    known = [
        r
        for r in rows
        if r["truth"] == "wrong" and "largest_mistake" in r and r.get("tolerance", 0) > 0
    ]
    for low, high in ((0, 0.01), (0.01, 0.1), (0.1, 1), (1, 10), (10, np.inf)):
        some = [r for r in known if low <= r["largest_mistake"] / r["tolerance"] < high]
        counts = [
            len(some),
            sum(map(seen, some)),
            *(sum(r["verdict"] == k for r in some) for k in ("equation-error", "unresolved")),
        ]
        lines.append(f"| {low:g} to {high:g} | " + " | ".join(map(str, counts)) + " |")
    return "\n".join(lines)


def truth_of(row: Row) -> set[str]:
    """Verdicts that are not false of a case; `unresolved` never is."""
    if row["truth"] == "wrong":
        return {"equation-error", "unresolved"}
    largest, tolerance = row.get("largest_integrator"), row.get("tolerance", np.nan)
    kinds = {"consistent", "integration-error", "unresolved"}
    if largest is None or not np.isfinite(tolerance):
        return kinds
    slack = row["integrator_slack"]
    if largest + slack < tolerance:
        kinds.discard("integration-error")
    elif largest - slack > tolerance:
        kinds.discard("consistent")
    return kinds


def _reliability(rows: list[Row]) -> str:
    """Of verdicts told at a probability, how many are true."""
    lines = ["| told probability | verdicts | not false | mean told |", "|---|--:|--:|--:|"]
    told = [(max(r["odds"].values()), r["verdict"] in truth_of(r)) for r in rows if r.get("odds")]
    for low, high in (
        (0, 0.5),
        (0.5, 0.8),
        (0.8, 0.95),
        (0.95, 0.99),
        (0.99, 0.999),
        (0.999, 1.01),
    ):
        some = [(p, ok) for p, ok in told if low <= p < high]
        mean = f"{np.mean([p for p, _ in some]):.4f}" if some else "–"
        lines.append(
            f"| {low:g} to {min(high, 1):g} | {len(some)} | {sum(ok for _, ok in some)} | {mean} |"
        )
    return "\n".join(lines)


def _cost(rows: list[Row]) -> str:
    lines = [
        "| speeds | audits | CPU median, s | worst, s | median per 1000 rows, s |",
        "|---|--:|--:|--:|--:|",
    ]
    timed = [r for r in rows if r["cpu"] > 0]
    for name, low, high in (
        ("1 to 2", 1, 2),
        ("3 to 5", 3, 5),
        ("6 and more", 6, 99),
        ("all", 1, 99),
    ):
        some = [r for r in timed if low <= r["nu"] <= high]
        if some:
            cpu = [r["cpu"] for r in some]
            per_row = np.median([1000 * r["cpu"] / r["rows"] for r in some])
            lines.append(
                f"| {name} | {len(some)} | {np.median(cpu):.2f} | {max(cpu):.1f} | {per_row:.2f} |"
            )
    return "\n".join(lines)


def _failures(rows: list[Row]) -> str:
    lines = []
    for row in rows:
        what = []
        if row["verdict"] in ("crashed", "refused"):
            what.append(f"{row['verdict']}: {row['message']}")
        if row["truth"] == "right" and seen(row):
            what.append("accused" if row["verdict"] == "equation-error" else "accused, small")
        if blamed(row):
            what.append(
                f"integrator blamed: true {row['largest_integrator']:.1e} J "
                f"of {row['tolerance']:.1e} J allowed"
            )
        if row["truth"] == "wrong" and not seen(row) and oracle_sees(row):
            what.append("missed")
        if row["truth"] == "right" and row["verdict"] == "unresolved":
            what.append("unresolved")
        for name in ("integrator", "mistake"):
            if covered(row, name) is False:
                told = row["told_integrator" if name == "integrator" else "told_equations"]
                error = row[
                    "told_integrator_error" if name == "integrator" else "told_equations_error"
                ]
                what.append(
                    f"{name} {told:.4g} ± {error:.2g} J told, {row[f'true_{name}']:.4g} true"
                )
        if row["truth"] == "wrong" and seen(row) and row.get("nameable") and row["rank"] != 0:
            what.append(f"named {row['causes'][:3]}")
        if what:
            only = f' --only "{row["only"]}"' if row["only"] else ""
            lines.append(
                f"- `--seed {row['seed']} --case {row['case']}{only}` {row['system']} {row['scheme']} "
                f"h={row['h']:g} {row['habit']} "
                f"{' '.join(row['notes'])} {row['fault']} {row['size']:.2g}: {'; '.join(what)}"
            )
    return "\n".join(lines)


# --- coverage, and the models of dm_control -----------------------------------------------------


def coverage(seed: int, count: int) -> str:
    """How often ΔC's 95 % bar holds the truth, which is the integrator's: pendulums with a motor."""
    import deltac as dc
    from judge import plants
    from judge.habits import Rows, kept
    from judge.truth import joules, simulated

    forms = ("noise", "decimals", "half", "thinned", "thinned+noise", "full")
    held: dict[str, list[bool]] = defaultdict(list)
    width: dict[str, list[float]] = defaultdict(list)
    for number in range(count):
        rng = np.random.default_rng([seed, number, 77])
        system, h = plants.pendulum(rng), 0.005
        plant = system.plant(system.numbers)
        w, size = rng.uniform(2, 9), rng.uniform(0.5, 4)
        scheme, hold = (
            str(rng.choice(["rk4", "semi-implicit-euler"])),
            str(rng.choice(["held", "ramped"])),
        )
        motion = simulated(
            plant,
            scheme,
            np.r_[rng.uniform(-1, 1), 0.0],
            h,
            200,
            lambda k, x, size=size, w=w: np.array([size * np.sin(w * k * 0.005)]),
            hold,
        )
        k = np.arange(len(motion.t))
        force = motion.torque(k, motion.t)
        form = forms[number % len(forms)]
        rows = kept(
            Rows(motion.t, motion.x[:, :1], motion.x[:, 1:], None, {"actuator motor": force}, k),
            form,
            rng,
        )
        model = system.mechanism(system.numbers)
        log = dc.Trajectory(
            t=rows.t,
            q=rows.q,
            u=rows.u,
            forces=rows.forces,
            coordinates=("pivot",),
            speeds=("pivot",),
            provenance=dc.Provenance("a user's own"),
        )
        audit = dc.audit(model, log)
        truth = joules(plant, plant, motion, True)
        end = int(rows.index[-1])
        told, bar = float(audit.energy_error[-1]), _bar(audit)
        error = abs(told - truth.integrator[end])
        held[form].append(error <= bar + truth.integrator_slack[end] + 1e-12)
        width[form].append(error / max(bar, 1e-300))
    lines = ["| form | logs | within the bar | median error / bar |", "|---|--:|--:|--:|"]
    for form in (*forms, "all"):
        inside = [x for f in held for x in held[f] if form in (f, "all")]
        ratios = [x for f in width for x in width[f] if form in (f, "all")]
        lines.append(
            f"| {form} | {len(inside)} | {100 * np.mean(inside):.1f} % | {np.median(ratios):.2g} |"
        )
    return "\n".join(lines)


def _bar(audit: Any) -> float:
    """The error bar of ΔC at the end of the log, J."""
    bar = audit.error_bar
    bar = bar[audit.function] if hasattr(bar, "keys") else bar
    return float(np.atleast_1d(bar)[-1])


def suite() -> str:
    """dm_control's models by RK4 with small sinusoidal controls, 1.5 s, recorded by `run_mujoco`."""
    import importlib.util

    import mujoco

    import deltac as dc

    spec = importlib.util.find_spec("dm_control")
    assert spec is not None and spec.submodule_search_locations
    folder = Path(next(iter(spec.submodule_search_locations))) / "suite"
    lines, decided, moved = (
        ["| model | speeds | verdict | ΔC ± bar, J | CPU, s |", "|---|--:|---|--:|--:|"],
        0,
        0,
    )
    for path in sorted(folder.glob("*.xml")):
        try:
            from dm_control.suite import common

            model = mujoco.MjModel.from_xml_string(path.read_text("utf-8"), common.ASSETS)
        except ValueError:
            try:
                model = mujoco.MjModel.from_xml_path(str(path))
            except ValueError as error:
                lines.append(f"| {path.stem} | | not loaded: {str(error)[:60]} | | |")
                continue

        def control(m: Any, d: Any) -> None:
            d.ctrl[:] = 0.1 * np.sin(3 * d.time + np.arange(m.nu))

        try:
            run = dc.run_mujoco(
                model,
                round(1.5 / model.opt.timestep) * model.opt.timestep,
                controller=control,
                integrator=_rk4(),
            )
        except dc.DeltacError as error:
            lines.append(f"| {path.stem} | {model.nv} | not recorded: {str(error)[:80]} | | |")
            continue
        if run.provenance.message or run.q.size == 0 or np.ptp(run.q, axis=0).max() < 1e-3:
            lines.append(
                f"| {path.stem} | {model.nv} | does not {'last' if run.provenance.message else 'move'} | | |"
            )
            continue
        moved += 1
        begun = time.process_time()
        try:
            audit = dc.audit(model, run)
        except Exception as error:  # noqa: BLE001, what crashes is a result of the bench
            lines.append(
                f"| {path.stem} | {model.nv} | {type(error).__name__}: {str(error)[:80]} | | |"
            )
            continue
        decided += audit.verdict.kind != "unresolved"
        bar = _bar(audit)
        lines.append(
            f"| {path.stem} | {model.nv} | {audit.verdict.kind} | {np.abs(audit.energy_error).max():.2g} "
            f"± {bar:.2g} | {time.process_time() - begun:.1f} |"
        )
    return "\n".join([*lines, f"\n{decided} of {moved} that move and last are decided"])


def _rk4() -> str:
    from deltac.recorders import integrator_names

    return next(name for name in integrator_names() if name.lower() == "rk4")


if __name__ == "__main__":
    main()
