"""The disk cache: where it goes, and that no state of it breaks a run or changes a number."""

from __future__ import annotations

import math
import os
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from deltac.errors import InputError
from deltac.kernels import cache_info, clear_cache
from deltac.kernels.cache import LIMIT
from slow import repeated

needs_heyoka = pytest.mark.heyoka

# sin(sin(… sin(0.5))), 30 times: known without any evaluator.
RUN = """
import casadi
from deltac.kernels import Kernel
x = casadi.SX.sym("x")
y = x
for _ in range(30):
    y = casadi.sin(y)
print(repr(float(Kernel({"x": x}, {"y": y})(x=0.5)["y"][0])))
"""


def expected() -> float:
    y = 0.5
    for _ in range(30):
        y = math.sin(y)
    return y


def run(folder: Path, code: str = RUN, **environment: str) -> str:
    """Run a small kernel in a new process; returns what it wrote to standard error."""
    pytest.importorskip("heyoka")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(sys.path),
        "DELTAC_EVALUATOR": "heyoka",
        "DELTAC_CACHE": "on",
        "DELTAC_CACHE_DIR": str(folder),
        **environment,
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == pytest.approx(expected(), rel=1e-14)  # 30 sines, 1 ulp each
    assert len(done.stdout.splitlines()) == 1, "the compiler must not write among the results"
    return done.stderr


def entries(folder: Path) -> list[tuple[int, int]]:
    """(hash, time of last use) of each entry."""
    connection = sqlite3.connect(folder / "cache.db")
    rows = connection.execute("SELECT hash, last_access FROM cache ORDER BY hash").fetchall()
    connection.close()
    return rows


def edit(folder: Path, statement: str, *values: object) -> None:
    connection = sqlite3.connect(folder / "cache.db")
    with connection:
        connection.execute(statement, values)
    connection.close()


@needs_heyoka
def test_second_process_finds_the_kernel(tmp_path: Path) -> None:
    assert run(tmp_path) == ""
    first = entries(tmp_path)
    assert first
    assert run(tmp_path) == ""
    second = entries(tmp_path)
    assert [h for h, _ in second] == [h for h, _ in first]
    assert max(t for _, t in second) > max(t for _, t in first), "the entries were not used"


def garble(file: Path) -> None:
    file.write_bytes(bytes(range(256)) * 40)


def truncate(file: Path) -> None:
    os.truncate(file, file.stat().st_size // 2)


def overwrite_header(file: Path) -> None:
    file.write_bytes(b"nothing SQLite knows" + file.read_bytes()[20:])


def overwrite_middle(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 2000] = bytes(2000)
    file.write_bytes(data)


def flip_a_bit_of_code(file: Path) -> None:
    """What SQLite cannot see, and a processor would run."""
    connection = sqlite3.connect(file)
    for key, code in connection.execute("SELECT hash, obj FROM cache").fetchall():
        flipped = bytearray(code)
        flipped[len(code) // 3] ^= 1
        connection.execute("UPDATE cache SET obj = ? WHERE hash = ?", (bytes(flipped), key))
    connection.commit()
    connection.close()


@needs_heyoka
@pytest.mark.parametrize(
    "damage",
    repeated(
        [garble, truncate, overwrite_header, overwrite_middle, flip_a_bit_of_code],
        garble,
        flip_a_bit_of_code,
    ),
)
def test_damaged_cache_is_emptied_with_a_warning(
    tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    run(tmp_path)
    damage(tmp_path / "cache.db")
    told = run(tmp_path)
    assert "was damaged" in told
    assert str(tmp_path) in told
    assert run(tmp_path) == ""  # and the next one is in order again
    assert entries(tmp_path)


@needs_heyoka
def test_entries_without_a_seal_are_compiled_again(tmp_path: Path) -> None:
    run(tmp_path)
    before = entries(tmp_path)
    (tmp_path / "seals.db").unlink()
    edit(tmp_path, "UPDATE cache SET obj = zeroblob(length(obj))")  # cannot run, if used
    assert run(tmp_path) == ""
    assert [h for h, _ in entries(tmp_path)] == [h for h, _ in before]


@needs_heyoka
def test_damaged_seals_are_no_obstacle(tmp_path: Path) -> None:
    run(tmp_path)
    garble(tmp_path / "seals.db")
    assert "was damaged" in run(tmp_path)
    assert run(tmp_path) == ""


@needs_heyoka
def test_tables_of_another_heyoka_are_left_alone(tmp_path: Path) -> None:
    run(tmp_path)
    edit(tmp_path, "UPDATE config SET value = 999 WHERE key = 'schema_version'")
    run(tmp_path)  # runs, whatever heyoka makes of it


@needs_heyoka
def test_unusable_folder_only_costs_time(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("in the way")
    told = run(file)
    assert "cannot be used" in told
    assert "DELTAC_CACHE=off" in told
    assert file.read_text() == "in the way"


@needs_heyoka
def test_cache_that_vanishes_in_a_run_only_costs_time(tmp_path: Path) -> None:
    vanish = "from deltac.kernels.cache import cache_folder, prepare_cache; prepare_cache()\n"
    vanish += "for file in cache_folder().iterdir(): file.unlink()\n"
    assert run(tmp_path, vanish + RUN) == ""


@needs_heyoka
def test_read_only_folder_only_costs_time(tmp_path: Path) -> None:
    run(tmp_path)
    tmp_path.chmod(0o555)
    try:
        if os.access(tmp_path, os.W_OK):
            pytest.skip("this user may write everywhere")
        assert "cannot be used" in run(tmp_path)
    finally:
        tmp_path.chmod(0o755)


@needs_heyoka
def test_cache_may_be_off(tmp_path: Path) -> None:
    assert run(tmp_path / "cache", DELTAC_CACHE="off") == ""
    assert not (tmp_path / "cache").exists()


@needs_heyoka
def test_info_and_clear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(tmp_path)
    (tmp_path / "mine.txt").write_text("not the cache's")
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("DELTAC_CACHE", "on")
    info = cache_info()
    written = sum(f.stat().st_size for f in tmp_path.glob("*.db"))
    assert (info.path, info.enabled, info.limit_bytes) == (tmp_path, True, LIMIT)
    assert info.size_bytes == written > 0
    clear_cache()
    assert cache_info().size_bytes == 0
    assert [f.name for f in tmp_path.iterdir()] == ["mine.txt"]


def test_folder_follows_the_xdg_rules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DELTAC_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_info().path == tmp_path / "deltac"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_info().path == tmp_path / "home" / ".cache" / "deltac"


def test_unknown_setting_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTAC_CACHE", "never")
    with pytest.raises(InputError, match="DELTAC_CACHE='never': expected 'on' or 'off'"):
        cache_info()
