"""Pages and comparisons of fleets, from tables made by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import polars as pl
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.fleets.result import fleet_status
from deltac.fleets.store import Store
from deltac.fleets.summary import recommended
from deltac.results import SHOWN
from tests.support.commands import command
from tests.support.pages import data_of


def made(folder: Path, rows: list[dict[str, Any]], kind: str = "sweep") -> Path:
    """A folder of results with these rows."""
    store = Store.make(folder, kind, "made", {})
    store.begin()
    addresses = [f"{k:024x}" for k in range(len(rows))]
    frame = pl.DataFrame(rows).insert_column(0, pl.Series("address", addresses))
    frame.write_parquet(folder / "pieces" / "all.parquet")
    store.plan(addresses)
    return folder


def run(solver: str, step: float, m: float, k: float, relative: float) -> dict[str, Any]:
    verdict = "consistent" if relative <= 1e-3 else "integration-error"
    return {
        "model": "arm",
        "solver": solver,
        "step": step,
        "duration": 1.0,
        "parameter.m": m,
        "parameter.k": k,
        "verdict": verdict,
        "relative": relative,
        "evaluations": (4.0 if solver == "ode4" else 6.0) / step,
        "seconds": 1e-3,
        "message": None,
        "code": None,
    }


def rows(scale: float = 1.0) -> list[dict[str, Any]]:
    """An error of fourth and one of fifth order."""
    return [
        run(solver, h, m, k, scale * m * k * (h / 0.1) ** order)
        for solver, order in (("ode4", 4), ("ode5", 5))
        for h in (0.1, 0.02, 0.01)
        for m in (1.0, 2.0, 3.0)
        for k in (1.0, 2.0)
    ]


def test_the_cheapest_setting_that_serves_all(tmp_path: Path) -> None:
    """ode4 errs by 6 · 0.2⁴ = 1e-2 at 0.02 s and 6e-4 at 0.01 s (400), ode5 by 2e-3 and 6e-5 (600)."""
    (best,) = recommended(Store.open(made(tmp_path / "a", rows())).table())
    assert best[:2] == ("arm", "ode4") and float(best[2]) == 0.01


def test_the_page(tmp_path: Path) -> None:
    fleet = fleet_status(made(tmp_path / "a", rows()))
    written: list[str] = []

    def case(address: str, path: Path) -> None:
        written.append(address)
        path.write_text("x")

    fleet.report(tmp_path / "page.html", x="parameter.m", y="parameter.k", case=case)
    page = (tmp_path / "page.html").read_text()
    parts = [part for chapter in data_of(page)["chapters"] for part in chapter["parts"]]
    maps = [part for part in parts if part["kind"] == "heat"]
    assert len(maps) == 2 and [part["kind"] for part in parts].count("points") == 1
    values = [v for one in maps for row in one["values"] for v in row]
    assert {(one["low"], one["high"]) for one in maps} == {(min(values), max(values))}
    assert all(len(one["values"]) == 2 and len(one["values"][0]) == 3 for one in maps)
    assert written == [row["address"] for row in fleet.worst[:SHOWN]]
    assert all(f"page-cases/{address}.html" in page for address in written)
    with pytest.raises(InputError, match="parameter.m"):
        fleet.report(tmp_path / "page.html", x="parameter.n")


def test_what_got_worse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, after = rows(), rows()
    after[0] = run("ode4", 0.1, 1.0, 1.0, 7.0)  # 1 before: larger, and as wrong as before
    after[9] = run("ode4", 0.02, 2.0, 2.0, 1e-4)  # 6.4e-3 before: better
    after[12] = run("ode4", 0.01, 1.0, 1.0, 1e-2)  # 1e-4 before: worse
    a, b = made(tmp_path / "a", before), made(tmp_path / "b", after[:-1])
    found = dc.compare(a, b)
    assert (found.rows, found.worse, found.better, found.grown, found.shrunk) == (35, 1, 1, 1, 0)
    assert (found.only_before, found.only_after, found.exit_code) == (1, 0, 1)
    assert [row["relative after"] for row in found.listed] == [1e-2, 7.0]
    assert dc.compare(a, a).exit_code == 0 and dc.compare(a, b, factor=10.0).grown == 0
    assert command("compare", str(a), str(b), capsys=capsys)[0] == 1
    code, _, said = command("compare", str(a), str(tmp_path), capsys=capsys)
    assert code == 2 and "fleet.json" in said


def test_logs_are_the_same_by_the_ends_of_their_paths(tmp_path: Path) -> None:
    def logs(folder: str, relative: float) -> list[dict[str, Any]]:
        names = [f"{folder}/{sub}/run.parquet" for sub in ("one", "two")]
        return [
            {"log": log, "episode": None, "verdict": "consistent", "relative": r, "exit_code": 0.0}
            for log, r in zip(names, (1e-6, relative))
        ]

    a = made(tmp_path / "a", logs("v1", 1e-6), "audit")
    b = made(tmp_path / "b", logs("v2", 1e-4), "audit")
    found = dc.compare(a, b)
    assert found.rows == 2 and found.grown == 1 and found.listed[0]["log"] == "two/run.parquet"
    with pytest.raises(InputError, match="like with like"):
        dc.compare(a, made(tmp_path / "c", rows()))


def test_a_fleet_that_is_not_complete(tmp_path: Path) -> None:
    folder = made(tmp_path / "a", rows())
    Store.open(folder).plan([f"{k:024x}" for k in range(40)])
    fleet = fleet_status(folder)
    assert (fleet.done, fleet.total, fleet.exit_code) == (36, 40, 3)
    assert len(fleet.frame) == 36
