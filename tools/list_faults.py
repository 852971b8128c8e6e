"""Write the catalogue of faults into `docs/faults.md`, between its two marks."""

from __future__ import annotations

import sys
from pathlib import Path

from firmware_sim.fault_catalogue import describe

TARGET = Path(__file__).parents[1] / "docs" / "faults.md"
BEGIN = "<!-- written by tools/list_faults.py -->"
END = "<!-- end of list -->"


def listed_in(text: str) -> str:
    """Return `text` with the present catalogue between the marks.

    Raises
    ------
    ValueError
        Where the marks are not there once each.
    """
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"{TARGET}: the lines {BEGIN!r} and {END!r} must stand there once each")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{describe()}\n{END}{after}"


def main() -> int:
    """Rewrite the page."""
    TARGET.write_text(listed_in(TARGET.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
