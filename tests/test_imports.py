"""The public names, and what loading them costs."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

import deltac

HEAVY = {"casadi", "heyoka", "llvmlite", "sympy", "scipy", "polars", "matplotlib"}
READERS = "deltac.trajectories.formats"
NAMESPACES = "bodies constraints events forces joints laws shapes".split()
PARTS = f"import deltac\n[getattr(deltac, name) for name in {[*NAMESPACES, 'Mechanism']}]"
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
    return (HEAVY | UNASKED | {READERS, "numpy"}) & set(last.split())


@pytest.mark.parametrize("code", ["import deltac", _command("--help")], ids=["deltac", "--help"])
def test_light_imports_load_no_heavy_package(code: str) -> None:
    assert _loaded_by(code) == set()


def test_parts_of_mechanisms_load_numpy_alone() -> None:
    assert _loaded_by(PARTS) == {"numpy"}


def test_a_study_loads_what_it_computes_with() -> None:
    study = _command("study", "triple-pendulum", "--steps", "0.02,0.01,0.005", "--json")
    assert _loaded_by(study) <= {"numpy", "casadi", "llvmlite"}


def test_the_probe_sees_a_heavy_package() -> None:
    assert _loaded_by("import sympy") == {"sympy"}


@pytest.mark.parametrize("name", sorted(deltac._PUBLIC))  # type: ignore[attr-defined]
def test_public_name_resolves(name: str) -> None:
    value = getattr(deltac, name)
    assert value is not None
    # A class or function carries the name it is published under; `record_drake` makes a DrakeRecorder.
    simulator = name.removeprefix("record_")
    known = name if simulator == name else f"{simulator.capitalize()}Recorder"
    assert getattr(value, "__name__", name).rpartition(".")[2] == known


def test_public_names_are_listed() -> None:
    # The verbs of the README and the commonest parts, by hand: none of them may get lost.
    verbs = "assemble audit balance check_equations explain_residual localise mutate_equations"
    verbs += " read_mechanism read_trajectory recommend repair_equations simulate simulate_ensemble study"
    parts = "Mechanism State Trajectory body free point_mass prismatic revolute rod"
    assert {*verbs.split(), *parts.split()} <= set(deltac.__all__) <= set(dir(deltac))


@pytest.mark.parametrize("name", NAMESPACES)
def test_a_namespace_is_a_module_that_lists_its_names(name: str) -> None:
    namespace = getattr(deltac, name)
    assert namespace is importlib.import_module(f"deltac.{name}")
    assert all(getattr(namespace, each).__doc__ for each in namespace.__all__)


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="simulat"):
        deltac.simulat  # type: ignore[attr-defined]  # noqa: B018
