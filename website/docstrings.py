"""Docstrings of classes list their attributes in columns; griffe is told what these columns are."""

from __future__ import annotations

import re
from typing import Any

import griffe

ROW = re.compile(r"^([\w.†λδΔ]+(?:, [\w.]+)*)  +(\S.*)$")


class Columns(griffe.Extension):
    """Turns ``name    meaning`` at the left margin, further lines indented, into a list."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring is not None:
            obj.docstring.value = listed(obj.docstring.value)


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
