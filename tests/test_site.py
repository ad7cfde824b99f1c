"""The pages of the site that are made from the code: everything public is on them."""

from __future__ import annotations

import re
from importlib import import_module

import pytest

pytest.importorskip("mkdocs", reason="the site needs the docs extra")
from website import hooks
from website.docstrings import fenced, listed

import deltac as dc
from deltac.cli import COMMANDS
from deltac.codes import COMMAND_ERRORS, FINDINGS, finding_code
from deltac.results import Report
from tests.natural_logs.cases import CASES


@pytest.mark.parametrize("program", ["animation", "gallery", "notebooks"])
def test_the_programs_of_the_site_import_what_there_is(program: str) -> None:
    pytest.importorskip("PIL", reason="pictures of the site need Pillow")
    import_module(f"website.{program}")


def test_every_command_and_its_options_are_told() -> None:
    text = "\n".join(hooks._commands())
    assert set(re.findall(r"^## deltac (\S+)", text, re.M)) >= set(COMMANDS)
    for option in ("--steps", "--figure", "--state", "--tolerance", "--repair", "--time-limit"):
        assert f"<code>{option}" in text
    rows = [line for line in text.splitlines() if line.startswith("| <code>")]
    assert all(row.count("|") == 4 for row in rows)


def test_every_public_name_is_in_the_reference() -> None:
    named = {shown for _, _, names in hooks._modules() for shown, _ in names}
    modules = {name for name in dc.__all__ if type(getattr(dc, name)).__name__ == "module"}
    assert {f"dc.{name}" for name in dc.__all__ if name not in modules} <= named
    assert {"dc.joints.spherical", "dc.forces.tendon", "dc.solvers.Scipy"} <= named


def test_the_keys_of_every_result() -> None:
    text = "\n".join(hooks._json_keys())
    for name in dc.__all__:
        kind = getattr(dc, name)
        if isinstance(kind, type) and issubclass(kind, Report):
            _, _, section = text.partition(f"## {name}\n")
            keys = re.findall(r"^\| `(\w+)` \|", section.partition("\n## ")[0], re.M)
            assert set(kind.json_keys()) - {"verdict"} <= set(keys), name


def test_codes_and_natural_logs_are_listed() -> None:
    codes = set(re.findall(r"^\| `([EF]-[A-Z0-9-]+)` \| \S", "\n".join(hooks._codes()), re.M))
    assert codes == {*map(finding_code, FINDINGS), *dc.InputError.codes(), *COMMAND_ERRORS}
    text = "\n".join(hooks._natural_logs())
    assert re.findall(r"^\| `(.+?)` \| \S", text, re.M) == [case.file for case in CASES]


def test_the_action_is_described() -> None:
    text = "\n".join(hooks._action((hooks.ROOT / "action.yml").read_text("utf-8")))
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in text.splitlines() if line[:1] == "|"]
    assert {len(row) for row in rows} == {2, 3}
    assert any("`tolerance`" in row[0] and "energy that the system has" in row[1] for row in rows)


def test_a_link_to_a_csv_file_alone_is_a_table() -> None:
    text = "Before.\n\n[results](data/a.csv)\n\nSee [results](data/a.csv), and so on.\n"
    (match,) = hooks.TABLE.finditer(text)
    assert match[1] == "data/a.csv"
    table = hooks._table(["name", "value"], [["|x|, y", "1.5"], ["", "-2e3"]])
    assert table.splitlines() == [
        "| name | value |",
        "| --- | ---: |",
        "| \\|x\\|, y | 1.5 |",
        "|  | -2e3 |",
    ]


def test_columns_of_docstrings_become_lists() -> None:
    text = "What it is.\n\nt          when (s)\nu, v       speeds, at\n           once\n\nEnd."
    assert listed(text) == ("What it is.\n\n\n- `t`: when (s)\n- `u`, `v`: speeds, at once\n\nEnd.")
    assert (
        listed("No columns here.\n    Indented  text.") == "No columns here.\n    Indented  text."
    )


def test_examples_of_docstrings_become_code() -> None:
    text = "What.\n\n>>> a = 1  # doctest: +SKIP\n>>> for _ in b:\n...     c()\n1\n\nEnd."
    code = "```python\na = 1\nfor _ in b:\n    c()\n```\n```text\n1\n```\n"
    assert fenced(text) == f"What.\n\n{code}\nEnd."


def test_links_into_the_code_lead_to_the_reference() -> None:
    place = hooks._reference()["src/deltac/recorders/drake_recorder.py"]
    assert place == "api/recorders.md#deltac.recorders.drake_recorder.DrakeRecorder"


def test_the_words_that_columns_are_read_by_are_listed() -> None:
    text = "\n".join(hooks._column_names())
    for word in ("qvel", "winkel", "desired", "fps", "`rpm`", "ctrl"):
        assert word in text
