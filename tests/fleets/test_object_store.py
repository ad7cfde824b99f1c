"""Logs in an object store: moto's S3 server, by s3fs, as a bucket of Amazon's would be read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import FileError
from deltac.fleets.audits import find_logs

NAME = "simple-pendulum"


@pytest.fixture(scope="module")
def store() -> Iterator[Any]:
    """The file system of a store; workers find it by the environment."""
    s3fs = pytest.importorskip("s3fs")
    moto = pytest.importorskip("moto.server")
    pytest.importorskip("flask_cors")
    server = moto.ThreadedMotoServer(port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        patch.setenv("AWS_ACCESS_KEY_ID", "testing")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "testing")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        found = s3fs.S3FileSystem(skip_instance_cache=True, use_listings_cache=False)
        found.mkdir("lab")
        yield found
    server.stop()


def run(angle: float) -> dc.Trajectory:
    problem = dc.problems.load(NAME)
    made = dc.simulate(problem, problem.mechanism.state([angle]), 1.0, 0.01)
    return replace(made, udot=None, integrals={}, works={}, provenance=dc.Provenance("another"))


@pytest.mark.slow
def test_a_bucket_of_logs(store: Any, tmp_path: Path) -> None:
    """As on a disk: verdicts, what is missing, what has changed, episodes."""
    motions = [run(0.2 + 0.1 * k) for k in range(3)]
    for k, motion in enumerate(motions[:2]):
        motion.write(tmp_path / f"{k}.parquet")
        store.put_file(str(tmp_path / f"{k}.parquet"), f"lab/runs/{k}.parquet")
    store.pipe("lab/runs/broken.parquet", b"PAR1 and nothing more")
    assert find_logs("s3://lab/runs/*.parquet")[0] == [
        f"s3://lab/runs/{name}.parquet" for name in ("0", "1", "broken")
    ]
    with pytest.raises(FileError, match="no object"):
        find_logs("s3://lab/none/*.parquet")
    arrays = {
        "t": motions[0].t,
        "qpos": np.stack([m.q for m in motions], axis=1),
        "qvel": np.stack([m.u for m in motions], axis=1),
    }
    np.savez(tmp_path / "batch.npz", **arrays)  # type: ignore[arg-type]
    store.put_file(str(tmp_path / "batch.npz"), "lab/batch.npz")
    logs = ["s3://lab/runs/*.parquet", "s3://lab/gone.parquet", "s3://lab/batch.npz"]
    # Processes that know the environment of now.
    first = dc.audit_many(NAME, logs, tmp_path / "out", workers=1)
    verdicts = first.frame["verdict"].to_list()
    assert verdicts == [*["consistent"] * 2, "failed", "failed", *["consistent"] * 3]
    assert first.frame["episode"].to_list()[-3:] == ["0", "1", "2"]
    local = dc.audit(NAME, tmp_path / "1.parquet")
    assert first.frame["relative"][1] == local.relative
    store.put_file(str(tmp_path / "1.parquet"), "lab/runs/broken.parquet")
    told: list[float] = []
    again = dc.audit_many(NAME, logs, tmp_path / "out", workers=1, progress=told.append)
    assert again.verdicts == {"consistent": 6, "failed": 1}
    assert told[0] == pytest.approx(6 / 7)
