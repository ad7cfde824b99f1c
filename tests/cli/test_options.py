"""Options of commands, made of the verbs that they call."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from deltac.cli import options


def verb(
    model: str,
    *,
    tolerance: float = 0.5,
    count: int | None = None,
    time_limit: float = 2.0,
    names: Sequence[str] = ("a",),
    fast: bool = False,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """A verb.

    Args:
        model: a model.
        tolerance: of no matter.
        count: how many `things` there are, of
            many.
        time_limit: seconds that it may take.
        names: some names.
        fast: whether.
        executor: does it.
        progress: called.
    """
    return {k: v for k, v in locals().items() if k != "model"}


@pytest.fixture
def application(monkeypatch: pytest.MonkeyPatch) -> tuple[typer.Typer, list[Any]]:
    module = ModuleType("verbs_of_a_test")
    module.verb = verb  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    found: list[Any] = []

    @options.of(verb=module.__name__, without="fast")
    def command(verb: options.Verb, model: options.Model) -> None:
        found.append(verb(model))

    made = typer.Typer(rich_markup_mode=None)
    made.command()(options.complete(command))
    return made, found


def test_keyword_arguments_become_options_and_are_handed_on_as_the_verb_takes_them(
    application: tuple[typer.Typer, list[Any]],
) -> None:
    made, found = application
    given = "m --tolerance 0.25 --count 3 --names x,y --time-limit 7".split()
    assert CliRunner().invoke(made, given).exit_code == 0
    assert CliRunner().invoke(made, ["m"]).exit_code == 0
    rest = {"fast": False, "executor": None, "progress": None}
    assert found == [
        {"tolerance": 0.25, "count": 3, "time_limit": 7.0, "names": ["x", "y"], **rest},
        {"tolerance": 0.5, "count": None, "time_limit": 2.0, "names": ("a",), **rest},
    ]


def test_help_says_what_the_docstring_says(application: tuple[typer.Typer, list[Any]]) -> None:
    said = " ".join(CliRunner().invoke(application[0], ["--help"]).output.split())
    assert "--count N How many things there are, of many." in said
    assert "--time-limit SECONDS Seconds that it may take. [default: 2.0]" in said
    for absent in ("--fast", "--executor", "--progress"):
        assert absent not in said


@pytest.mark.parametrize("given", [["m", "--count", "few"], ["m", "--fast"], []])
def test_what_does_not_fit_is_an_error_of_usage(
    application: tuple[typer.Typer, list[Any]], given: list[str]
) -> None:
    assert CliRunner().invoke(application[0], given).exit_code == 2
