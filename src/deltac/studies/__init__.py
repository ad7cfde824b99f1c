"""Studies: published experiments run again, and problems compared with their references."""

from __future__ import annotations
