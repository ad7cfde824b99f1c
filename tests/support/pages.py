"""What a page holds."""

from __future__ import annotations

import base64
import json
import re
from typing import Any

import numpy as np


def data_of(text: str) -> dict[str, Any]:
    """The JSON of a page, its arrays unpacked."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert found is not None

    def unpacked(entry: dict[str, Any]) -> Any:
        for kind in ("f4", "f8"):
            if list(entry) == [kind]:
                return np.frombuffer(base64.b64decode(entry[kind]), f"<{kind}")
        return entry

    contents: dict[str, Any] = json.loads(found.group(1), object_hook=unpacked)
    return contents
