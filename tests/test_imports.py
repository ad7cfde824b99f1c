"""The public names, and what loading them costs."""

from __future__ import annotations

import subprocess
import sys

import pytest

import deltac

HEAVY = {"casadi", "heyoka", "sympy", "scipy", "polars", "matplotlib"}
UNASKED = {f"deltac.{name}" for name in ("report", "recorders", "importers", "repair")}


def _command(*arguments: str) -> str:
    """Code that runs a command of deltac, which must end well."""
    return f"""
from deltac.cli import main
sys.argv = ["deltac", *{arguments!r}]
try:
    main()
except SystemExit as stop:
    assert not stop.code, stop.code
"""


def _loaded_by(code: str) -> set[str]:
    """The heavy packages and unasked parts of deltac that a fresh interpreter holds after `code`."""
    script = f"import sys\n{code}\nprint('loaded:', *sys.modules)"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    last = run.stdout.splitlines()[-1]
    assert last.startswith("loaded: ")
    return (HEAVY | UNASKED) & set(last.split())


@pytest.mark.parametrize(
    "code",
    ["import deltac", "import deltac.mechanism", _command("--help")],
    ids=["deltac", "deltac.mechanism", "deltac --help"],
)
def test_light_imports_load_no_heavy_package(code: str) -> None:
    assert _loaded_by(code) == set()


def test_a_study_loads_what_it_computes_with() -> None:
    study = _command("study", "triple-pendulum", "--steps", "0.02,0.01,0.005", "--json")
    assert _loaded_by(study) <= {"casadi", "heyoka", "sympy"}


def test_the_probe_sees_a_heavy_package() -> None:
    assert _loaded_by("import sympy") == {"sympy"}


@pytest.mark.parametrize("name", sorted(deltac._PUBLIC))
def test_public_name_resolves(name: str) -> None:
    value = getattr(deltac, name)
    assert value is not None
    # A class or function carries the name it is published under.
    assert getattr(value, "__name__", name).rpartition(".")[2] == name


def test_public_names_are_listed() -> None:
    assert set(deltac._PUBLIC) == set(deltac.__all__)
    assert set(deltac.__all__) <= set(dir(deltac))
    assert "simulate" in deltac.__all__


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="simulat"):
        deltac.simulat  # noqa: B018
