"""What guards against foreign input: limits, regular files, scripts of users, processes that may crash."""

from __future__ import annotations
