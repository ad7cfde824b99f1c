"""Docstrings list attributes in columns and show examples with prompts; griffe is told what these are."""

from __future__ import annotations

import re
from typing import Any

import griffe

ROW = re.compile(r"^([\w.†λδΔ]+(?:, [\w.]+)*)  +(\S.*)$")


EXAMPLE = re.compile(r"(?:^(?:>>>|\.\.\.)(?: .*)?\n)+(?:^(?!>>>)\S.*\n)*", re.MULTILINE)


class Columns(griffe.Extension):
    """Turns ``name    meaning`` at the left margin, indented below, into a list; examples into code."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring is not None:
            obj.docstring.value = listed(fenced(obj.docstring.value))


def fenced(text: str) -> str:
    """The text with its examples as code, without prompts and without remarks to doctest."""

    def code(match: re.Match[str]) -> str:
        lines = [re.sub(r"\s*# doctest: .*", "", line) for line in match[0].splitlines()]
        typed = [line[4:] for line in lines if line[:3] in (">>>", "...")]
        shown = [line for line in lines if line[:3] not in (">>>", "...")]
        block = "\n".join(["```python", *typed, "```", ""])
        return block + "\n".join(["```text", *shown, "```", ""]) * bool(shown)

    return EXAMPLE.sub(code, text + "\n").rstrip("\n")


def listed(text: str) -> str:
    """The text with its columns as a list in Markdown."""
    lines: list[str] = []
    inside = False
    for line in text.split("\n"):
        row = ROW.match(line)
        if row:
            names = ", ".join(f"`{name}`" for name in row[1].split(", "))
            lines += ([] if inside else [""]) + [f"- {names}: {row[2].strip()}"]
            inside = True
        elif inside and line.startswith("   "):
            lines[-1] += f" {line.strip()}"
        else:
            lines += ["", line] if inside and line.strip() else [line]
            inside = False
    return "\n".join(lines)
