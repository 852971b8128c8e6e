"""Draw the safety state machine of `TRANSITIONS` into `docs/safety.md`, between its two marks."""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

from robotctl.runtime.messages import SafetyState
from robotctl.runtime.safety import POWERED, TRANSITIONS, SafetyMachine

TARGET = Path(__file__).parents[1] / "docs" / "safety.md"
BEGIN = "<!-- drawn by tools/draw_states.py -->"
END = "<!-- end of drawing -->"


def diagram() -> str:
    """Return the state machine in Mermaid's words; events of one way share an arrow."""
    ways: dict[tuple[SafetyState, SafetyState], list[str]] = defaultdict(list)
    for (state, event), new in TRANSITIONS.items():
        ways[state, new].append(event.value)
    arrows = [
        f"    {state.name} --> {new.name}: {' / '.join(events)}"
        for (state, new), events in ways.items()
    ]
    powered = ",".join(state.name for state in SafetyState if state in POWERED)
    return "\n".join(
        (
            "```mermaid",
            "stateDiagram-v2",
            f"    [*] --> {SafetyMachine().state.name}",
            *arrows,
            "    classDef powered stroke-width:4px",
            f"    class {powered} powered",
            "```",
        )
    )


def drawn_into(text: str) -> str:
    """Return `text` with the present diagram between the marks.

    Raises
    ------
    ValueError
        Where the marks are not there once each.
    """
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"{TARGET}: the lines {BEGIN!r} and {END!r} must stand there once each")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{diagram()}\n{END}{after}"


def main() -> int:
    """Rewrite the page."""
    TARGET.write_text(drawn_into(TARGET.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
