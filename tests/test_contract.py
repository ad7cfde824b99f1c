"""What stays the same within 1.x: every result against the schema of JSON, every key of it listed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from website import json_schema

import deltac as dc
from tests.support.commands import command

PUBLISHED = json.loads(json_schema.FILE.read_text("utf-8"))
PENDULUM = dc.problems.load("simple-pendulum")


@cache
def run() -> dc.Trajectory:
    return dc.simulate(PENDULUM, duration=1.0, step=0.01, solver="ode4")


def wrong(t: float, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    return np.array([-9.81 * np.cos(q[0])])


def source(folder: Path) -> str:
    file = folder / "equations.py"
    file.write_text(
        "import numpy as np\ndef rhs(t, q, u):\n    return np.array([-9.81 * np.cos(q[0])])\n"
    )
    return f"{file}:rhs"


def fleet(folder: Path) -> dc.Fleet:
    return dc.sweep(PENDULUM, folder, vary={"step": [0.1, 0.05]}, duration=0.2, workers=1)


def compared(folder: Path) -> dc.Comparison:
    return dc.compare(fleet(folder / "before").folder, fleet(folder / "after").folder)


RESULTS: dict[str, Callable[[Path], Any]] = {
    "Audit": lambda _: dc.audit(PENDULUM, replace(run(), u=1.01 * run().u)),
    "Classification": lambda _: dc.classify("rolling-disc"),
    "Comparison": compared,
    "Correction": lambda _: dc.correct_trajectory(PENDULUM, run()),
    "EquationCheck": lambda _: dc.check_equations(PENDULUM, wrong),
    "Equilibrium": lambda _: dc.equilibrium(PENDULUM, {"pivot": -1.5}),
    "Examination": lambda _: dc.examine(PENDULUM, duration=0.5, log=run()),
    "Explanation": lambda _: dc.explain_residual(PENDULUM, run()),
    "Fleet": fleet,
    "Ledger": lambda _: dc.balance(PENDULUM, run()),
    "Linearisation": lambda _: dc.linearise(PENDULUM),
    "Localisation": lambda _: dc.localise(PENDULUM, run()),
    "MutationReport": lambda folder: dc.mutate_equations(PENDULUM, source(folder)),
    "Recommendation": lambda _: dc.recommend(PENDULUM, duration=0.5),
    "Repair": lambda folder: dc.repair_equations(PENDULUM, source(folder)),
    "Study": lambda _: dc.study(PENDULUM, duration=0.5, steps=[0.1, 0.05, 0.025]),
    "Verdict": lambda _: dc.audit(PENDULUM, run()).verdict,
}


def closed(part: Any) -> Any:
    """The schema without further keys, which readers must allow and a release must list."""
    if isinstance(part, list):
        return [closed(item) for item in part]
    if not isinstance(part, Mapping):
        return part
    limit = {"additionalProperties": False} if "properties" in part and "required" in part else {}
    return {**limit, **{key: closed(value) for key, value in part.items()}}


def test_the_published_schema_is_that_of_the_classes() -> None:
    jsonschema.Draft202012Validator.check_schema(PUBLISHED)
    assert json_schema.schema() == PUBLISHED, "a key changed: make schema, and tell CHANGELOG.md"


def test_every_public_result_is_validated() -> None:
    assert set(RESULTS) == {kind.__name__ for kind in json_schema.results()}


@pytest.mark.parametrize("name", RESULTS)
def test_results_follow_the_published_schema(name: str, tmp_path: Path) -> None:
    result = RESULTS[name](tmp_path)
    contents = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    jsonschema.validate(contents, PUBLISHED)
    assert contents["report"] == name
    own = {k: v for k, v in contents.items() if k not in ("schema", "deltac", "report")}
    schema = {"$ref": f"#/$defs/{name}", "$defs": closed(PUBLISHED["$defs"])}
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(own)
    assert not validator.is_valid(own | {"another": 1})
    assert not validator.is_valid({key: own[key] for key in own if key != "findings"})


def test_errors_follow_the_published_schema(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = command("audit", "no-such-model", "run.csv", "--json", capsys=capsys)
    contents = json.loads(out)
    assert status == contents["exit_code"] == 2
    jsonschema.validate(contents, PUBLISHED)
    assert contents["error"]["code"] == "E-NAME"
