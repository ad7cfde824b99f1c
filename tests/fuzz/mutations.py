"""How inputs are changed: bytes, words of the formats, and values in JSON documents."""

from __future__ import annotations

import json
import random
from typing import Any

WORDS = [
    *(
        "0",
        "-1",
        "1e999",
        "-0.0",
        "nan",
        "inf",
        "NaN",
        "Infinity",
        "null",
        "true",
        "9" * 20,
        "9" * 400,
    ),
    *(
        "²",
        "٣",
        "１",
        "_",
        "é",
        "\0",
        "\ufeff",
        "\n",
        "\r\n",
        "\t",
        ",",
        ";",
        "=",
        "'",
        '"',
        "#",
        "\\",
    ),
    *(
        "[" * 80,
        "]" * 80,
        "{" * 80,
        "(" * 80,
        "(" * 3,
        ")" * 3,
        "**",
        "^",
        "//",
        "9**9**9",
        "e",
        "..",
        ".",
    ),
    *(
        "time",
        "q.",
        "u.",
        "force.",
        "force.gravity.",
        "deltac",
        "endheader",
        "--json",
        "--help",
        "q[",
        "<a>",
    ),
]
VALUES: list[Any] = [
    *(None, True, False, 0, -1, 1, 2**63, 10**30, 10**400, 1.5, float("nan"), float("inf"), -1e308),
    *(
        "",
        "a",
        "é",
        "impact floor",
        "gravity",
        "\0",
        [],
        {},
        [1],
        ["a"],
        [[1]],
        {"a": 1},
        [None],
        [0.0, 0.0],
    ),
]


def mutated(rng: random.Random, pool: list[bytes]) -> bytes:
    """One of the pool, changed a few times."""
    data = rng.choice(pool)
    if data[:1] in b"{[" and rng.random() < 0.7:
        data = _json(rng, data)
    for _ in range(rng.choice((0, 1, 1, 1, 2, 4, 8))):
        data = _changed(rng, data, pool)
    return data[:100_000]


def _changed(rng: random.Random, data: bytes, pool: list[bytes]) -> bytes:
    i, j = sorted((rng.randrange(len(data) + 1), rng.randrange(len(data) + 1)))
    match rng.randrange(8):
        case 0:  # a bit
            changed = bytearray(data or b"\0")
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
            return bytes(changed)
        case 1:  # a byte
            return data[:i] + bytes([rng.randrange(256)]) + data[i + 1 :]
        case 2:
            return data[:i] + rng.choice(WORDS).encode() + data[i:]
        case 3:
            return data[:i] + rng.choice(WORDS).encode() + data[min(j, i + 8) :]
        case 4:
            return data[:i] + data[j:]
        case 5:
            return data[:j] + data[i : min(j, i + 200)] * rng.choice((1, 2, 20)) + data[j:]
        case 6:  # a number of four bytes
            number = rng.choice((0, 1, 2**31 - 1, 2**31, 2**32 - 1, rng.randrange(2**32)))
            return data[:i] + number.to_bytes(4, "little") + data[i + 4 :]
    other = rng.choice(pool)
    return data[:i] + other[rng.randrange(len(other) + 1) :]


def _json(rng: random.Random, data: bytes) -> bytes:
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return data
    for _ in range(rng.choice((1, 1, 2))):
        document = _replaced(rng, document)
    return json.dumps(document).encode()


def _replaced(rng: random.Random, value: Any) -> Any:
    """A document of which one value, at any depth, is another."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        if rng.random() < 0.1:
            return {k: v for k, v in value.items() if k != key}
        return {**value, key: _replaced(rng, value[key])}
    if isinstance(value, list) and value and rng.random() < 0.7:
        place = rng.randrange(len(value))
        return [*value[:place], _replaced(rng, value[place]), *value[place + 1 :]]
    return rng.choice(VALUES)
