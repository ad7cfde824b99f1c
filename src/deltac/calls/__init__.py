"""What all calls have in common: arguments, old names, Ctrl-C, progress, and what is kept between them."""

from __future__ import annotations
