"""`python -m deltac`: the command line, where the script itself is not on the path."""

from __future__ import annotations

from deltac.cli import main

if __name__ == "__main__":
    main()
