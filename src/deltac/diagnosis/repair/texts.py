"""Edits applied to the text: the user's formatting stays, and only the edited expression changes."""

from __future__ import annotations

import ast
import difflib
from collections.abc import Sequence
from pathlib import Path

from deltac.diagnosis.repair.candidates import Candidate
from deltac.diagnosis.repair.source import Source


def apply(source: Source, edits: Sequence[Candidate]) -> Source | None:
    """The source with edits of different places applied; None where they overlap."""
    spans = sorted(
        ((source.span(source.nodes[e.place]), e) for e in edits), key=lambda x: x[0], reverse=True
    )
    text = source.text
    last = len(text) + 1
    for (start, end), edit in spans:
        if end > last:
            return None
        last = start
        node = source.nodes[edit.place]
        bare = text[:start] + edit.text + text[end:]
        if isinstance(node, ast.stmt):
            text = bare
            continue
        safe = f"{text[:start]}({edit.text}){text[end:]}"
        text = bare if _same(bare, safe) else safe
    return source.replaced(text)


def _same(bare: str, safe: str) -> bool:
    """Whether parentheses make no difference to what a text means."""
    try:
        return ast.dump(ast.parse(bare)) == ast.dump(ast.parse(safe))
    except SyntaxError:
        return False


def unified_diff(source: Source, changed: Source) -> str:
    """A patch that `git apply` and `patch -p1` take: in the root of the repository, or where we are."""
    name = _patch_name(source)
    lines = difflib.unified_diff(
        source.text.splitlines(keepends=True),
        changed.text.splitlines(keepends=True),
        f"a/{name}",
        f"b/{name}",
    )
    text = ""
    for line in lines:
        text += line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"
    return text


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
