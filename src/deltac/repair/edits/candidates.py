"""A candidate edit: one node of the source replaced by a tree in which other parts keep the user's text."""

from __future__ import annotations

import ast
import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

from deltac.foreign.scripts import called
from deltac.repair.tracing.source import Source


@dataclass(frozen=True, eq=False, repr=False)
class EditCandidate:
    """An edit that may be the repair.

    source  the text that is edited
    place   the node that is replaced, by its place in `source.nodes`
    new     what replaces it: a text, or a tree, in which nodes of the source stand for themselves and names
            may be any text that is in scope (`s["x1"]`)
    kind    sign, operator, name, index, function, power, number, factor, term, order
    cost    how much is changed: 1 for one sign, operator or name; more for what is put in
    comment the edit in words, where they are not "… should be …"
    """

    source: Source
    place: int
    new: ast.AST | str
    kind: str
    cost: float
    comment: str = ""

    @cached_property
    def text(self) -> str:
        """What the node's text is replaced by."""
        return self.new if isinstance(self.new, str) else rendered(self.source, self.new)

    @property
    def words(self) -> str:
        """The edit in words, after "eom.py:24: "."""
        own = short(self.source.segment(self.source.nodes[self.place]))
        return self.comment or f"{own} should be {short(self.text)}"


# --- texts ----------------------------------------------------------------------------------------

ATOMS = (ast.Name, ast.Attribute, ast.Subscript, ast.Call, ast.Constant, ast.List, ast.Tuple)
"""Nodes whose text needs no parentheses anywhere."""


def rendered(source: Source, tree: ast.AST) -> str:
    """A tree as text, its parts that are nodes of the source as the user wrote them."""
    parts: list[ast.AST] = []
    outline = ast.unparse(_outline(source, tree, parts)).replace(" ** ", "**")
    meant = _dump(ast.unparse(tree))
    enclosed = {k for k, part in enumerate(parts) if not isinstance(part, ATOMS)}

    def text(enclosed: set[int]) -> str:
        def part(match: re.Match[str]) -> str:
            k = int(match[1])
            own = source.segment(parts[k])
            return f"({own})" if k in enclosed else own

        return re.sub(r"\b_(\d+)_\b", part, outline)

    for k in sorted(enclosed):
        if _dump(text(enclosed - {k})) == meant:
            enclosed.remove(k)
    best = text(enclosed)
    return best if _dump(best) == meant else ast.unparse(tree)


def _outline(source: Source, tree: ast.AST, parts: list[ast.AST]) -> ast.AST:
    """A copy of a tree with the names `_0_`, `_1_` … for the nodes of the source in it."""
    if isinstance(tree, ast.expr) and id(tree) in source.number:
        parts.append(tree)
        return ast.Name(f"_{len(parts) - 1}_", ast.Load())

    def copied(value: object) -> object:
        if isinstance(value, list):
            return [copied(one) for one in value]
        return _outline(source, value, parts) if isinstance(value, ast.AST) else value

    fields = {name: copied(value) for name, value in ast.iter_fields(tree)}
    return ast.fix_missing_locations(type(tree)(**fields))


def _dump(text: str) -> str:
    """What a text means; the text itself where it is no Python."""
    for enclosed in (f"({text}\n)", text):
        try:
            return ast.dump(ast.parse(enclosed))
        except SyntaxError:
            continue
    return text


def variable(text: str) -> ast.Name:
    """A name, or an entry or attribute that is in scope, as a leaf of a tree."""
    return ast.Name(text, ast.Load())


def product(node: ast.expr, factor: ast.expr, divide: bool = False) -> ast.expr:
    """A node times (or by) a factor."""
    return ast.BinOp(node, ast.Div() if divide else ast.Mult(), factor)


def total(node: ast.expr, term: ast.expr, subtract: bool = False) -> ast.expr:
    """A node plus (or minus) a term."""
    return ast.BinOp(node, ast.Sub() if subtract else ast.Add(), term)


def negated(node: ast.expr) -> ast.expr:
    """A node with a minus."""
    return ast.UnaryOp(ast.USub(), node)


def short(text: str, limit: int = 70) -> str:
    """A text on one line, its middle left out where it is long."""
    line = " ".join(text.split())
    return line if len(line) <= limit else f"{line[: limit // 2]} … {line[-limit // 2 + 3 :]}"


def family(text: str) -> str:
    """What names of one family share: l1 and l3, len_a and len_b, q[0] and q[2], p["m1"] and p["m2"]."""
    return re.sub(r"\d+|(?<=_)[A-Za-z]\b", "#", text)


def stem(text: str) -> str:
    """What names of one index share: S21 and C21, th1 and w1."""
    return re.sub(r"[^\d]+", "", text)


def number_cost(number: float) -> float:
    """How unlikely it is that this number was meant: more than a name or a sign, small whole ones least."""
    negative = 0.25 if number < 0 else 0.0
    if float(number).is_integer() and abs(number) <= 12:
        return 1.25 + negative
    return (1.4 if float(f"{number:.4g}") == number else 1.5) + negative


def functions_used(source: Source) -> dict[str, str]:
    """The names by which this source calls sin and cos."""
    names: dict[str, str] = {}
    for node in source.nodes:
        if isinstance(node, ast.Call) and called(node) in ("sin", "cos"):
            name, text = called(node), source.segment(node.func)
            prefix = text.rpartition(".")[0]
            names[name] = text
            if prefix:
                other = "cos" if name == "sin" else "sin"
                names.setdefault(other, f"{prefix}.{other}")
    return dict(sorted(names.items()))


# --- edits applied --------------------------------------------------------------------------------


EditSet: TypeAlias = tuple[EditCandidate, ...]
"""Edits that are made together."""

EditedSource: TypeAlias = tuple[EditSet, Source]
"""Edits, and the source that they make."""


def apply(source: Source, edits: Sequence[EditCandidate]) -> Source | None:
    """The source with edits of different places applied; None where they overlap.

    An edit within what another one replaces is made in that one's text, if its own stands there once.
    """
    if len(edits) == 2:
        for outer, inner in (edits, edits[::-1]):
            (a, b), (c, d) = (source.span(source.nodes[e.place]) for e in (outer, inner))
            if a <= c and d <= b and outer.place != inner.place:
                return _nested(source, outer, inner, source.text[c:d])
    spans = sorted(
        ((source.span(source.nodes[e.place]), e) for e in edits), key=lambda x: x[0], reverse=True
    )
    text = source.text
    last = len(text) + 1
    for (start, end), edit in spans:
        if end > last:
            return None
        last = start
        bare = text[:start] + edit.text + text[end:]
        safe = f"{text[:start]}({edit.text}){text[end:]}"
        text = bare if _dump(bare) == _dump(safe) else safe
    return source.replaced(text)


def _nested(source: Source, outer: EditCandidate, inner: EditCandidate, own: str) -> Source | None:
    """The source with one edit made, and another in its text where `own` stands there once."""
    matches = list(re.finditer(rf"(?<![\w.]){re.escape(own)}(?!\w)", outer.text))
    if len(matches) != 1:
        return None
    start, end = matches[0].span()
    text = f"{outer.text[:start]}({inner.text}){outer.text[end:]}"
    return apply(source, [replace(outer, new=text)])


def unified_diff(source: Source, changed: Source) -> str:
    """A patch that `git apply` and `patch -p1` take: in the root of the repository, or where we are."""
    name = _patch_name(source)
    lines = difflib.unified_diff(
        source.text.splitlines(keepends=True),
        changed.text.splitlines(keepends=True),
        f"a/{name}",
        f"b/{name}",
    )
    return "".join(_ended(line) for line in lines)


def _ended(line: str) -> str:
    return line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"


def _patch_name(source: Source) -> str:
    """The file's path from the root of its repository, else from the working folder, else its name."""
    if source.path is None:
        return source.name.rpartition("/")[2]
    path = source.path.resolve()
    roots = [folder for folder in path.parents if (folder / ".git").exists()][:1]
    for root in (*roots, Path.cwd().resolve()):
        if path.is_relative_to(root):
            return path.relative_to(root).as_posix()
    return path.name
