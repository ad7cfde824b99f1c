"""What all calls have in common: arguments, Ctrl-C, progress, and what is kept between them."""

from __future__ import annotations
