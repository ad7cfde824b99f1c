"""The history of figures: a loss is told, where it is of the same kind of processor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

history = pytest.importorskip("history", reason="the benchmarks are no part of a package")


def measured(ratio: float, verdict: float, processor: str = "one", day: int = 23) -> dict[str, Any]:
    return {
        "machine": {"date": f"2026-11-{day}", "processor": processor, "cores": 2},
        "contests": [{"name": "a / b", "ratio": ratio}, {"name": "c", "skipped": "not here"}],
        "startup": {"verdict_s": {"warm": verdict}, "kernels": []},
    }


def test_a_loss_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "HISTORY", tmp_path / "history.json")
    results = tmp_path / "benchmarks.json"
    for found in (measured(8.0, 1.0), measured(1.0, 9.0, "other"), measured(5.0, 1.1, day=24)):
        results.write_text(json.dumps(found))
        history.add(results)
    kept = json.loads((tmp_path / "history.json").read_text())
    assert [entry["processor"] for entry in kept] == ["one", "other", "one"]
    rows = [line.split(" | ") for line in history.table(kept).splitlines()[2:]]
    assert len(rows) == 4
    assert [row[0] for row in rows if "LOST" in row[-1]] == ["| a / b"]


def test_what_is_kept_can_be_told() -> None:
    entries = json.loads(history.HISTORY.read_text(encoding="utf-8"))
    assert entries and history.table(entries).count("\n") > 5
