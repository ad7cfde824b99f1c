"""Every ```python block in the documents runs, and prints what the ```text block after it shows."""

from __future__ import annotations

import contextlib
import doctest
import importlib
import io
import itertools
import math
import pkgutil
import re
from pathlib import Path

import pytest

import deltac

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
NAMES = [str(path.relative_to(ROOT)) for path in DOCUMENTS]

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(
    r"(?<![\w.])[-+]?(?:\d+\.\d*|\.\d+|\d+(?=[eE]))(?:[eE][-+]?\d+)?|\b(?:nan|inf)\b"
)
LINK = re.compile(r"\]\((?!\w+:)([^)#\s]*)(?:#([^)\s]*))?\)")
IMAGE = re.compile(r'<img [^>]*src="([^"]+)"')
AUDITS = ("docs/audit.md", "docs/explain.md", "docs/scipy.md")
"""Documents whose examples audit logs."""
ROUNDING = 1e-8  # smaller numbers are sizes of errors: only their magnitude is meant


@pytest.mark.parametrize(
    "document",
    [
        pytest.param(path, id=name, marks=[pytest.mark.long] if name in AUDITS else [])
        for path, name in zip(DOCUMENTS, NAMES)
    ],
)
def test_examples_run_and_print_what_they_show(
    document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {"__name__": "__main__"}
    blocks = [(m[1], m[2], m.start()) for m in FENCE.finditer(document.read_text("utf-8"))]
    for (language, code, start), following in itertools.zip_longest(blocks, blocks[1:]):
        if language != "python":
            continue
        line = document.read_text("utf-8")[:start].count("\n") + 1
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile("\n" * line + code, str(document), "exec"), namespace)
        shown = following[1] if following is not None and following[0] == "text" else ""
        assert_same_text(printed.getvalue(), shown, f"{document.name}:{line}")


def assert_same_text(found: str, shown: str, where: str) -> None:
    """The same words, and numbers equal to a unit of the last digit shown; spaces do not count."""
    words_found, words_shown = (NUMBER.sub("#", text).split() for text in (found, shown))
    assert words_found == words_shown, f"{where} prints\n{found}"
    for a, b in zip(NUMBER.findall(found), NUMBER.findall(shown), strict=True):
        assert _same_number(a, b), f"{where} prints {a}, shown is {b}, in\n{found}"


def _same_number(found: str, shown: str) -> bool:
    a, b = float(found), float(shown)
    if not (math.isfinite(a) and math.isfinite(b)):
        return found == shown
    mantissa, _, exponent = shown.lower().partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    if 0.0 < abs(b) < ROUNDING:
        return abs(b) / 10.0 <= abs(a) <= abs(b) * 10.0
    return abs(a - b) <= 1.01 * unit


@pytest.mark.parametrize(
    ("found", "same"),
    [
        ("K = 2.721 J", True),
        ("K  =   2.722 J", True),  # a unit of the last digit
        ("K = 2.723 J", False),
        ("V = 2.721 J", False),
        ("K = nan J", False),
        ("K = 2.721", False),
    ],
)
def test_the_comparison_tells_right_from_wrong(found: str, same: bool) -> None:
    if same:
        assert_same_text(found, "K = 2.721 J", "here")
    else:
        with pytest.raises(AssertionError):
            assert_same_text(found, "K = 2.721 J", "here")


def test_sizes_of_errors_may_differ_by_less_than_ten() -> None:
    assert _same_number("4.1e-13", "2e-13")
    assert not _same_number("4.1e-12", "2e-13")
    assert not _same_number("0.0", "2e-13")


@pytest.mark.parametrize("document", DOCUMENTS, ids=NAMES)
def test_links_lead_somewhere(document: Path) -> None:
    text = FENCE.sub("", document.read_text("utf-8"))
    for path, anchor in [*LINK.findall(text), *((src, "") for src in IMAGE.findall(text))]:
        target = (document.parent / path) if path else document
        assert target.exists(), f"{document.name} links to {path}, which is not there"
        if anchor and target.suffix == ".md":
            assert anchor in _anchors(target), f"{document.name}: {path} has no heading #{anchor}"


def _anchors(document: Path) -> set[str]:
    """The anchors that headings get on the usual hosts."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", document.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in headings}


@pytest.mark.long
def test_examples_in_docstrings() -> None:
    failed, attempted = 0, 0
    for info in pkgutil.walk_packages(deltac.__path__, "deltac."):
        if info.name.endswith("__main__"):
            continue
        outcome = doctest.testmod(
            importlib.import_module(info.name), optionflags=doctest.ELLIPSIS, verbose=False
        )
        failed += outcome.failed
        attempted += outcome.attempted
    assert attempted > 0
    assert failed == 0, "see the captured output"


def test_lists_that_the_guides_name_are_there() -> None:
    """Who adds a part looks for these lists by the names in the guides."""
    guides = "".join(
        (ROOT / f"{name}.md").read_text("utf-8") for name in ("ARCHITECTURE", "CONTRIBUTING")
    )
    named = set(re.findall(r"`(_?[A-Z]{4,}(?:_[A-Z]+)*)`", guides))
    folders = ("src", "tests", "benchmarks")
    files = [p for folder in folders for p in (ROOT / folder).rglob("*.py")]
    stated = {
        name
        for p in files
        for name in re.findall(r"^(_?[A-Z_]+)\b", p.read_text("utf-8"), re.MULTILINE)
    }
    assert len(named) > 10 and {n for n in named if not n.startswith("DELTAC")} <= stated


def test_the_notation_names_all_there_is() -> None:
    from deltac.dynamics.testing_functions import TESTING_FUNCTIONS
    from deltac.mechanism import channels, joints
    from deltac.simulation.solvers import SOLVERS
    from deltac.trajectories.formats.files import FORMATS

    text = (ROOT / "NOTATION.md").read_text("utf-8")
    aliases = [alias for solver in SOLVERS.values() for alias in solver.aliases]
    named = [*joints.JOINT_KINDS, *channels.CHANNEL_KINDS, *SOLVERS, *aliases, *TESTING_FUNCTIONS]
    parts = {
        s for kind in joints.JOINT_KINDS.values() for s, _ in (*kind.coordinates, *kind.speeds) if s
    }
    named += [f".{part}" for part in parts]
    parts_of = [deltac.bodies, deltac.constraints, deltac.events, deltac.forces]
    named += [*FORMATS, *(n for module in parts_of for n in module.__all__ if n.islower())]
    missing = [name for name in named if f"`{name}`" not in text]
    assert not missing
