"""What import-linter does not see: texts that name modules above, circles, and clients that know too much.

import-linter follows `import` statements between packages alone. The root of the package is exempt: it stands
above all, and declares which module has a public name or a service.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

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

parsed = cache(ast.parse)
"""Several tests look at all of the package: each of its texts is parsed once."""


def upward(source: str, package: str) -> list[str]:
    """Texts in the code that are paths of modules which stand above a package."""
    nodes = list(ast.walk(parsed(source)))
    documentation = {
        id(node.value)
        for node in nodes
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    texts = {
        node.value
        for node in nodes
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


def path_of(module: str) -> Path:
    path = ROOT / "src" / module.replace(".", "/")
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def statements(node: ast.AST) -> Iterator[ast.ImportFrom]:
    """Imports from modules of deltac, also in functions; not those for type checkers."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ImportFrom) and str(child.module).startswith("deltac."):
            yield child
        elif not (isinstance(child, ast.If) and getattr(child.test, "id", "") == "TYPE_CHECKING"):
            yield from statements(child)


def graph(modules: Mapping[str, str]) -> dict[str, set[str]]:
    """Module -> the modules that it imports, at any time."""
    edges: dict[str, set[str]] = {}
    for module, source in modules.items():
        targets = set()
        for statement in statements(parsed(source)):
            for alias in statement.names:
                inner = f"{statement.module}.{alias.name}"
                targets.add(inner if inner in modules else str(statement.module))
        edges[module] = targets - {module}
    return edges


@cache
def sources() -> dict[str, str]:
    files = (ROOT / "src/deltac").rglob("*.py")
    names = {".".join(p.relative_to(ROOT / "src").with_suffix("").parts): p for p in files}
    return {m.removesuffix(".__init__"): p.read_text("utf-8") for m, p in names.items()}


def test_a_circle_is_seen() -> None:
    a = "def f():\n    from deltac.b import g"
    edges = graph({"deltac.a": a, "deltac.b": "from deltac.a import f"})
    with pytest.raises(CycleError):
        TopologicalSorter(edges).prepare()


def test_imports_make_no_circle() -> None:
    """Not even those that are made when a function is called."""
    TopologicalSorter(graph(sources())).prepare()


@cache
def public_names() -> set[tuple[str, str]]:
    """(module, name) of what stubs and public modules list; fronts of the core are for packages alone."""
    fronts = {ROOT / "src/deltac" / name / "__init__.pyi" for name in CORE} - {TRAJECTORIES}
    stubs = [*{*(ROOT / "src/deltac").rglob("__init__.pyi")} - fronts]
    spaces = [path_of(f"deltac.{name}") for name in PUBLIC_MODULES]
    trees = {path: ast.parse(path.read_text("utf-8")) for path in (*stubs, *spaces)}
    names = {
        (home, alias.name)
        for path, tree in trees.items()
        for statement in tree.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
        for home in (str(statement.module), f"deltac.{path.stem}")
    }
    return names | {("deltac", name) for name in PUBLIC_MODULES}


PUBLIC_MODULES = (
    "bodies",
    "joints",
    "forces",
    "constraints",
    "events",
    "shapes",
    "laws",
    "solvers",
)
COMMON = ("deltac.arrays", "deltac.rotations", "deltac.errors", "deltac.results")
"""What every package may know: a type of arrays, rotations, errors, the base of what verbs return."""


@pytest.mark.parametrize("client", ["problems", "testing"])
def test_clients_import_public_names_only(client: str) -> None:
    """What a problem or an assertion is made of, a user has as well.

    `deltac.energy` is the core of the verb `balance`, which problems below the door call.
    """
    public = public_names() | {("deltac.energy", "balance"), ("deltac.mechanism.laws", "LawLike")}
    private = [
        (module, statement.module, alias.name)
        for module, source in sources().items()
        if module.startswith(f"deltac.{client}")
        for statement in ast.walk(parsed(source))
        if isinstance(statement, ast.ImportFrom) and str(statement.module).startswith("deltac")
        if not str(statement.module).startswith((f"deltac.{client}", *COMMON))
        for alias in statement.names
        if (statement.module, alias.name) not in public | {("deltac", "rotations")}
        if statement.module != "deltac" or alias.name != client
    ]
    assert private == []


CORE = "mechanism dynamics kernels trajectories simulation energy models verbs diagnosis".split()
TRAJECTORIES = ROOT / "src/deltac/trajectories/__init__.pyi"


def test_commands_import_public_names_of_the_core_only() -> None:
    """They may know each other and the reports, of the core what a user can."""
    homes = {("deltac.trajectories", n) for m, n in public_names() if "trajectories" in m}
    private = {
        (module, statement.module, alias.name)
        for module, source in sources().items()
        if module.startswith("deltac.cli")
        for statement in statements(parsed(source))
        if str(statement.module).split(".")[1] in CORE
        for alias in statement.names
        if (statement.module, alias.name) not in public_names() | homes
    }
    assert private == set()


def test_every_service_is_there() -> None:
    assert all(callable(getattr(import_module(home), name)) for name, home in provided().items())
