"""What names, pipes and environments can do to the command line: nothing but its job."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from deltac.cli import main
from deltac.cli.output import displayed
from deltac.errors import InputError, LimitError
from deltac.foreign.limits import parse_toml

DELTAC = [sys.executable, "-c", "from deltac.cli import main; main()"]


def outcome(*words: str) -> int:
    with pytest.raises(SystemExit) as stopped:
        main(words)
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def test_names_are_no_commands_of_terminals_and_workflows() -> None:
    assert displayed("a\x1b[2Jb\x9b31m\u202ec") == r"a\x1b[2Jb\x9b31m\u202ec"
    assert displayed("Δ of\tθ\nnext") == "Δ of\tθ\nnext"
    for text in ("::error::x", "a\n  ::set-output name=a::b", "##[group]a"):
        lines = displayed(text).splitlines()
        assert not any(line.strip().startswith("::") or "##[" in line for line in lines)


def test_a_column_cannot_write_to_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "a\n::error::b.csv"
    log.write_text("time,q.\x1b[2Ja\n0,1\n1,2\n2,3\n")
    assert outcome("audit", "double-pendulum", str(log)) == 2
    said = capsys.readouterr()
    assert "\x1b" not in said.err and "\n::" not in said.err + said.out


@pytest.mark.parametrize("form", ["{}/run.csv", "{}.csv"])
def test_a_name_too_long_is_bad_input(form: str) -> None:
    assert outcome("audit", "double-pendulum", form.format("9" * 300)) == 2
    assert outcome("describe", form.format("9" * 300).replace(".csv", ".urdf")) == 2


def test_keys_of_a_hundred_thousand_dots_are_refused_at_once() -> None:
    start = time.process_time()
    for text in (".".join("a" * 100_000) + " = 1", "[" + " . ".join("a" * 100_000) + "]"):
        with pytest.raises(LimitError, match="nesting"):
            parse_toml(text)
    assert time.process_time() - start < 2.0
    rates = ", ".join(["1.5"] * 1000)
    assert parse_toml(f"a.b.c = [{rates}]\n")["a"]["b"]["c"][-1] == 1.5


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_model_cannot_make_it_wait(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    from deltac.importers import read_mechanism

    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "m.xml").write_text('<mujoco><include file="pipe"/></mujoco>')
    with pytest.raises(InputError, match="not a regular file"):
        read_mechanism(tmp_path / "m.xml")


def test_an_fmu_that_unpacks_to_too_much(tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    from deltac import load_fmu

    with (
        zipfile.ZipFile(tmp_path / "bomb.fmu", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("resources/big", "w") as file,
    ):
        for _ in range(300):
            file.write(bytes(2**20))
    with pytest.raises(InputError, match="unpack") as caught:
        load_fmu(tmp_path / "bomb.fmu")
    assert caught.value.code == "E-LIMIT"


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="a POSIX shell")
def test_closed_and_full_outputs(tmp_path: Path) -> None:
    """A reader that has seen enough, and a disk that is full: no traceback, no internal error."""
    read, write = os.pipe()
    os.close(read)
    closed = subprocess.run(
        [*DELTAC, "problems"], stdout=write, stderr=subprocess.PIPE, check=False
    )
    os.close(write)
    assert (closed.returncode, closed.stderr) == (141, b"")
    if Path("/dev/full").exists():
        with open("/dev/full", "w", encoding="ascii") as full:
            ended = subprocess.run([*DELTAC, "problems"], stdout=full, stderr=-1, check=False)
        assert ended.returncode == 2 and b"Traceback" not in ended.stderr
