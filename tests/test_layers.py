"""No module names one of a package above it, not even in a text that is imported later.

import-linter follows `import` statements alone. The root of the package is exempt: it stands above all, and
declares which module has a public name or a service.
"""

from __future__ import annotations

import ast
import re
import tomllib
from importlib import import_module
from pathlib import Path

from deltac.calls.services import provided

ROOT = Path(__file__).parents[1]
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
    "contracts"
]
LAYERS = next(c["layers"] for c in CONTRACTS if c["id"] == "layers")
LEVEL = {
    name.strip(" ()"): len(LAYERS) - k
    for k, layer in enumerate(LAYERS)
    for name in re.split("[|:]", layer)
}
"""Package -> how high it stands."""


def upward(source: str, package: str) -> list[str]:
    """Texts in the code that are paths of modules which stand above a package."""
    documentation = {
        id(node.value)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    texts = {
        node.value
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and id(node) not in documentation
    }
    paths = [text for text in texts if re.fullmatch(r"deltac(\.\w+)+(:\w+)?", text)]
    return [p for p in paths if LEVEL.get(p.split(".")[1].split(":")[0], 0) > LEVEL[package]]


def test_a_text_that_names_a_module_above_is_seen() -> None:
    source = 'import_module("deltac.report.plots")'
    assert upward(source, "results") == ["deltac.report.plots"] and not upward(source, "cli")


def test_no_text_names_a_module_above() -> None:
    files = [p for p in (ROOT / "src/deltac").rglob("*.py") if p.parent.name != "deltac"]
    files += [p for p in (ROOT / "src/deltac").glob("*.py") if p.stem[:2] != "__"]
    places = {p: p.relative_to(ROOT / "src/deltac").with_suffix("").parts[0] for p in files}
    found = {str(p): upward(p.read_text("utf-8"), package) for p, package in places.items()}
    assert {p: texts for p, texts in found.items() if texts} == {}


def test_every_service_is_there() -> None:
    assert all(callable(getattr(import_module(home), name)) for name, home in provided().items())
