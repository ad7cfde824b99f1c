"""The JSON Schema of results, from their classes: ``python -m website.json_schema`` writes it.

The file is kept in the repository, so that a change of a key is seen in its difference; a test compares both,
and validates what the verbs return.
"""

# mypy: disable-error-code="arg-type"

from __future__ import annotations

import ast
import inspect
import json
import sys
import types
import typing
from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path, PurePath
from typing import Any, Literal

import numpy as np

import deltac
from deltac.diagnosis.verdict import Judged, Verdict, VerdictKind
from deltac.results import SCHEMA, Report, Serialisable

FILE = Path(__file__).parents[1] / "docs" / "assets" / "results.schema.json"

EXIT_CODES = {"enum": [0, 1, 3]}
NUMBER = {"type": ["number", "null"]}
NUMBERS = {
    "type": ["array", "number", "integer", "boolean", "null"],
    "items": {"$ref": "#/$defs/Array"},
}


def results() -> list[type[Report]]:
    """The public classes of results."""
    public = (getattr(deltac, name) for name in deltac.__all__)
    return [kind for kind in public if isinstance(kind, type) and issubclass(kind, Report)]


def schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) of `to_dict()` of every public result, and of ``--json`` of an error.

    Further keys are allowed, as later versions may add some. Keys that stand here are always there.
    """
    defs = Definitions()
    kinds = {kind.__name__: defs.of(kind) for kind in results()}
    error = _object({"code": {"type": "string", "pattern": "^E-"}, "message": {"type": "string"}})
    defs.entries["Error"] = _object({"exit_code": {"enum": [2, 70]}, "error": error})
    kinds["Error"] = {"$ref": "#/$defs/Error"}
    head = _object(
        {"schema": {"const": SCHEMA}, "deltac": {"type": "string"}, "report": {"enum": [*kinds]}}
    )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Results of deltac",
        **head,
        "allOf": [
            {"if": {"properties": {"report": {"const": name}}}, "then": reference}
            for name, reference in kinds.items()
        ],
        "$defs": {"Array": NUMBERS, **dict(sorted(defs.entries.items()))},
    }


class Definitions:
    """Schemas of classes by name, each with those that its keys refer to."""

    def __init__(self) -> None:
        self.entries: dict[str, dict[str, Any]] = {}
        self.classes: dict[str, type] = {}

    def of(self, kind: type) -> dict[str, str]:
        """The reference to a class, whose schema is added; that of a base includes its subclasses."""
        name = kind.__name__
        if self.classes.setdefault(name, kind) is not kind:
            name = f"{kind.__module__.split('.')[1]}-{name}"
            self.classes[name] = kind
        if name not in self.entries:
            self.entries[name] = {}
            of_kind: list[type] = kind.__subclasses__()
            subclasses = [self.of(k) for k in of_kind if is_dataclass(k)]
            own = [_object(self.keys(kind))] if is_dataclass(kind) else []
            self.entries[name] = {"anyOf": [*own, *subclasses]} if subclasses else own[0]
        return {"$ref": f"#/$defs/{name}"}

    def keys(self, kind: type) -> dict[str, Any]:
        """The schema of each key that a class has in JSON."""
        if not issubclass(kind, Serialisable):
            names = [f.name for f in fields(kind) if f.metadata.get("json", True)]
            return {name: self.holding(annotation(kind, name)) for name in names}
        keys = {name: self.holding(annotation(kind, name)) for name in kind.json_keys()}
        if issubclass(kind, Judged):
            parts = {name: self.holding(annotation(Verdict, name)) for name in JUDGED}
            keys = {
                "verdict": self.holding(VerdictKind),
                **parts,
                **{k: v for k, v in keys.items() if k != "verdict"},
            }
        if kind.__name__ == "Linearisation":
            keys["eigenvalues"] = self.holding(list[tuple[float, float]])
        if issubclass(kind, Report):
            keys = {
                "exit_code": EXIT_CODES,
                **keys,
                "findings": self.holding(annotation(Report, "findings")),
            }
        return keys

    def holding(self, hint: Any) -> dict[str, Any]:
        """The schema of values of a type."""
        origin, arguments = typing.get_origin(hint), typing.get_args(hint)
        if hint is Any or isinstance(hint, typing.TypeVar):
            return {}
        if origin is Literal:
            return {"enum": list(arguments)}
        if origin in (typing.Union, types.UnionType):
            parts = [self.holding(a) for a in arguments]
            return {"anyOf": [part for k, part in enumerate(parts) if part not in parts[:k]]}
        simple = SIMPLE.get(origin or hint)
        if simple is not None:
            return simple
        container = origin or hint
        if isinstance(container, type) and issubclass(container, Mapping):
            return {
                "type": "object",
                "additionalProperties": self.holding(arguments[1]) if arguments else {},
            }
        if container is tuple and arguments[-1:] != (...,) and arguments:
            items = [self.holding(a) for a in arguments]
            return {"type": "array", "prefixItems": items, "items": False, "minItems": len(items)}
        if isinstance(container, type) and issubclass(container, Collection):
            return {"type": "array", "items": self.holding(arguments[0]) if arguments else {}}
        if isinstance(container, type) and (
            is_dataclass(container) or issubclass(container, Serialisable)
        ):
            return self.of(container)
        raise TypeError(f"no schema for {hint!r}")


JUDGED = ("confidence", "meaning", "evidence", "limits")
"""What the JSON of a result takes from its verdict."""

SIMPLE: dict[Any, dict[str, Any]] = {
    type(None): {"type": "null"},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: NUMBER,
    str: {"type": "string"},
    np.ndarray: {"$ref": "#/$defs/Array"},
    Path: {"type": "string"},
    PurePath: {"type": "string"},
}


def _object(properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": properties, "required": list(properties)}


def annotation(kind: type, name: str) -> Any:
    """The type of an attribute, or of what a property or method returns, names for type checkers included."""
    value = inspect.getattr_static(kind, name, None)
    function = value.fget if isinstance(value, property) else getattr(value, "func", value)
    if callable(function) and not isinstance(function, type):
        return _hints(function, function.__module__)["return"]
    owner = next(c for c in kind.__mro__ if name in c.__dict__.get("__annotations__", {}))
    return _hints(owner, owner.__module__)[name]


def _hints(value: Any, module: str) -> dict[str, Any]:
    return typing.get_type_hints(value, localns=_names_of_type_checkers(module))


def _names_of_type_checkers(module: str) -> dict[str, Any]:
    """What a module imports and defines for type checkers alone."""
    path = str(sys.modules[module].__file__)
    tree = ast.parse(Path(path).read_text("utf-8"))
    blocks = [
        n for n in tree.body if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.unparse(n.test)
    ]
    names: dict[str, Any] = dict(vars(sys.modules[module]))
    for block in blocks:
        exec(compile(ast.Module(block.body, []), path, "exec"), names)
    return names


if __name__ == "__main__":
    FILE.write_text(json.dumps(schema(), indent=1, ensure_ascii=False) + "\n", "utf-8")
