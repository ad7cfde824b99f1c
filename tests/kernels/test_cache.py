"""The disk cache: where it goes, and that no state of it breaks a run or changes a number."""

from __future__ import annotations

import hashlib
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deltac.errors import InputError
from deltac.foreign.files import appearing
from deltac.kernels import CacheWarning, cache, cache_info, clear_cache, compiled, verify_cache
from deltac.kernels.cache import CACHE_BYTES

needs_llvm = pytest.mark.heyoka


@pytest.fixture(autouse=True)
def warned_of_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "_warned", [])


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
    pytest.importorskip("llvmlite")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(sys.path),
        "DELTAC_EVALUATOR": "llvm",
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


def entries(folder: Path) -> dict[str, float]:
    """When each file was last used, by its name."""
    return {file.name: file.stat().st_mtime for file in folder.glob("*.kernel")}


@needs_llvm
def test_second_process_finds_the_kernel(tmp_path: Path) -> None:
    assert run(tmp_path) == ""
    first = entries(tmp_path)
    assert len(first) == 1
    for file in tmp_path.iterdir():
        os.utime(file, (1e9, 1e9))
    assert run(tmp_path) == ""
    second = entries(tmp_path)
    assert second.keys() == first.keys()
    assert min(second.values()) > 1e9, "the entry was not used"


def empty(file: Path) -> None:
    file.write_bytes(b"")


def garble(file: Path) -> None:
    file.write_bytes(bytes(range(256)) * 40)


def truncate(file: Path) -> None:
    os.truncate(file, file.stat().st_size // 2)


def flip_a_bit_of_code(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 3] ^= 1
    file.write_bytes(data)


def digest_without_a_key(file: Path) -> None:
    """As anybody could seal it."""
    content = b"json\n[0]"
    file.write_bytes(hashlib.blake2b(content, digest_size=32).digest() + content)


def pickle_that_runs(file: Path) -> None:
    code = pickle.dumps(Planted())
    file.write_bytes(hashlib.blake2b(code, digest_size=32).digest() + code)


class Planted:
    def __reduce__(self) -> Any:
        return pytest.fail, ("what was planted was run",)


def seal_something_else(file: Path) -> None:
    """A right seal of what cannot be read, as another version may have written it."""
    secret = cache._secret()
    assert secret is not None
    file.write_bytes(cache._seal(file.name, b"pickle\n", secret) + b"pickle\n")


def open_to_others(file: Path) -> None:
    file.chmod(0o666)


def link_to_a_copy(file: Path) -> None:
    copy = file.parent.parent / "copy"
    file.rename(copy)
    file.symlink_to(copy)


@pytest.mark.parametrize(
    "damage",
    [
        empty,
        garble,
        truncate,
        flip_a_bit_of_code,
        digest_without_a_key,
        pickle_that_runs,
        seal_something_else,
        open_to_others,
        link_to_a_copy,
    ],
)
def test_a_damaged_file_is_made_anew(
    tmp_path: Path, damage: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "cache"
    compiled("anything", lambda: list(range(100)), folder)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    damage(file)
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(folder))
    if damage is not seal_something_else:  # whose seal is right
        assert list(verify_cache()) == [str(file)]
    with pytest.warns(CacheWarning) as caught:
        assert compiled("anything", lambda: list(range(100)), folder) == list(range(100))
    assert len(caught) == 1 and str(file) in str(caught[0].message)
    assert file.read_bytes() == whole and not file.is_symlink()
    assert list(folder.iterdir()) == [file]
    assert verify_cache() == {}


def test_kernels_that_were_exchanged_are_made_anew(tmp_path: Path) -> None:
    compiled("one", lambda: "the first", tmp_path)
    (first,) = tmp_path.iterdir()
    compiled("two", lambda: "the second", tmp_path)
    (second,) = set(tmp_path.iterdir()) - {first}
    contents = first.read_bytes(), second.read_bytes()
    second.write_bytes(contents[0])
    first.write_bytes(contents[1])
    with pytest.warns(CacheWarning):
        assert compiled("one", lambda: "the first", tmp_path) == "the first"
    assert compiled("two", lambda: "the second", tmp_path) == "the second"
    assert (first.read_bytes(), second.read_bytes()) == contents


def test_files_of_another_key_are_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a cache that was restored from elsewhere."""
    compiled("anything", lambda: 1, tmp_path / "cache")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with pytest.warns(CacheWarning):
        assert compiled("anything", lambda: 2, tmp_path / "cache") == 2
    (key,) = (tmp_path / "state" / "deltac").iterdir()
    assert key.stat().st_mode & 0o777 == 0o600 and key.stat().st_size == 32
    assert compiled("anything", lambda: 3, tmp_path / "cache") == 2


@pytest.mark.parametrize("spoil", [lambda key: key.chmod(0o644), lambda key: key.write_bytes(b"1")])
def test_a_key_that_others_may_know_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoil: Callable[[Path], None]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    cache._secret_in.cache_clear()
    old = cache._secret()
    assert old is not None and cache._secret() == old
    key = tmp_path / "deltac" / "kernels.key"
    spoil(key)
    cache._secret_in.cache_clear()
    new = cache._secret()
    assert new is not None and new != old and len(new) == 32
    assert key.read_bytes() == new and key.stat().st_mode & 0o777 == 0o600


def test_without_a_place_for_a_key_nothing_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    assert compiled("anything", lambda: 1, tmp_path / "cache") == 1
    assert compiled("anything", lambda: 2, tmp_path / "cache") == 2
    assert not (tmp_path / "cache").exists()


def test_a_folder_that_others_may_write_to_is_not_used(tmp_path: Path) -> None:
    compiled("anything", lambda: 1, tmp_path)
    tmp_path.chmod(0o777)
    with pytest.warns(CacheWarning, match="can be written by others"):
        assert compiled("anything", lambda: 2, tmp_path) == 2
    tmp_path.chmod(0o700)
    assert compiled("anything", lambda: 3, tmp_path) == 1


def test_a_new_folder_is_closed_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        compiled("anything", lambda: 1, tmp_path / "cache")
    finally:
        os.umask(before)
    (file,) = (tmp_path / "cache").iterdir()
    assert (tmp_path / "cache").stat().st_mode & 0o777 == 0o700
    assert file.stat().st_mode & 0o777 == 0o600


@needs_llvm
def test_damaged_code_is_compiled_again(tmp_path: Path) -> None:
    run(tmp_path)
    (file,) = tmp_path.iterdir()
    flip_a_bit_of_code(file)
    said = run(tmp_path)
    assert len(said.splitlines()) == 1 and "CacheWarning" in said
    assert run(tmp_path) == ""
    assert list(tmp_path.iterdir()) == [file]


def test_code_of_another_version_has_another_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compiled("sources, version 1", lambda: 1, tmp_path) == 1
    assert compiled("sources, version 2", lambda: 2, tmp_path) == 2
    monkeypatch.setattr("deltac.kernels.cache.processor", lambda: (("machine", "another"),))
    assert compiled("sources, version 1", lambda: 3, tmp_path) == 3
    monkeypatch.undo()
    assert compiled("sources, version 1", lambda: 4, tmp_path) == 1
    assert len(entries(tmp_path)) == 3


def test_what_was_used_longest_ago_goes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deltac.kernels.cache.CACHE_BYTES", 4000)
    monkeypatch.setattr("deltac.kernels.cache.KEPT", 3000)
    for k in range(4):
        compiled(f"{k}", lambda: bytes(900), tmp_path)
        for age, file in enumerate(sorted(tmp_path.iterdir(), key=os.path.getmtime)):
            os.utime(file, (1e9 + age, 1e9 + age))
    compiled("0", lambda: pytest.fail("it is still there"), tmp_path)  # used now
    compiled("4", lambda: bytes(900), tmp_path)  # too much: 1 and 2 go
    assert len(entries(tmp_path)) == 3
    for k in (0, 3, 4):
        compiled(f"{k}", lambda: pytest.fail("it was used later"), tmp_path)


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    old = tmp_path / ".deltac-0123456789ab.tmp"
    old.write_bytes(b"unfinished")
    with appearing(tmp_path / "new") as file:  # somebody is writing it
        compiled("anything", lambda: 1, tmp_path)
        assert not old.exists()
        assert Path(file.name).exists()
    assert (tmp_path / "new").exists()


@needs_llvm
def test_unusable_folder_only_costs_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    file.write_text("in the way")
    assert run(file) == ""
    assert file.read_text() == "in the way"
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(file))
    assert not cache_info().writable


@needs_llvm
def test_cache_that_vanishes_in_a_run_only_costs_time(tmp_path: Path) -> None:
    vanish = "import shutil, deltac.kernels.llvm_evaluator\n"
    vanish += f"shutil.rmtree({str(tmp_path)!r})\n"
    assert run(tmp_path, vanish + RUN) == ""


@needs_llvm
def test_read_only_folder_only_costs_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tmp_path.chmod(0o555)
    try:
        if os.access(tmp_path, os.W_OK):
            pytest.skip("this user may write everywhere")
        assert run(tmp_path) == ""
        monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path))
        assert not cache_info().writable
    finally:
        tmp_path.chmod(0o755)


@needs_llvm
def test_cache_may_be_off(tmp_path: Path) -> None:
    assert run(tmp_path / "cache", DELTAC_CACHE="off") == ""
    assert not (tmp_path / "cache").exists()


@needs_llvm
def test_info_and_clear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(tmp_path)
    (tmp_path / "mine.txt").write_text("not the cache's")
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("DELTAC_CACHE", "on")
    info = cache_info()
    written = sum(f.stat().st_size for f in tmp_path.glob("*.kernel"))
    assert (info.path, info.enabled, info.writable) == (tmp_path, True, True)
    assert (info.entries, info.limit_bytes) == (1, CACHE_BYTES)
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


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="users have no numbers here")
def test_code_of_another_user_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled("anything", lambda: 1, tmp_path)
    monkeypatch.setattr(os, "getuid", lambda: -7)
    with pytest.warns(CacheWarning, match="another user"):
        assert compiled("anything", lambda: 2, tmp_path) == 2


def test_other_files_in_the_folder_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    others = [tmp_path / name for name in ("image.iso.part", "gauss.kernel", "notes.txt")]
    for file in others:
        file.write_text("a user's")
        os.utime(file, (1e9, 1e9))
    monkeypatch.setattr("deltac.kernels.cache.CACHE_BYTES", 10)
    compiled("anything", lambda: 1, tmp_path)
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path))
    assert cache_info().entries <= 1
    clear_cache()
    assert sorted(tmp_path.iterdir()) == sorted(others)


def test_an_entry_that_cannot_be_removed_does_not_lift_the_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deltac.kernels.cache.CACHE_BYTES", 4000)
    monkeypatch.setattr("deltac.kernels.cache.KEPT", 3000)
    stuck = tmp_path / f"{0:040x}.kernel"
    stuck.mkdir()  # no file, so that it cannot be unlinked
    os.utime(stuck, (1e9, 1e9))
    for k in range(20):
        compiled(f"{k}", lambda: bytes(900), tmp_path)
    assert 1 <= len(entries(tmp_path)) <= 5
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path))
    with pytest.raises(InputError, match="1 of . files cannot be removed"):
        clear_cache()
    assert list(tmp_path.iterdir()) == [stuck]
