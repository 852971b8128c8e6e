"""Write the parts of the documentation that the code itself states, each between its two marks."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

from pymavlink.dialects.v20 import ardupilotmega, common

from firmware_sim.faults.catalogue import describe
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import Context, TelemetryRobot
from robotctl.mavlink.parameters.table import PARAMETERS
from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.registry import SERVICES
from robotctl.messages.control import SafetyState
from robotctl.safety.state_machine import ENABLED, TRANSITIONS, SafetyMachine

DOCS = Path(__file__).parents[1] / "docs"
BEGIN = "<!-- written by tools/write_docs.py -->"
END = "<!-- end of what is written -->"


def diagram() -> str:
    """Return the state machine in Mermaid's words; events of one way share an arrow."""
    ways: dict[tuple[SafetyState, SafetyState], list[str]] = defaultdict(list)
    for (state, event), new in TRANSITIONS.items():
        ways[state, new].append(event.value)
    arrows = [
        f"    {state.name} --> {new.name}: {' / '.join(events)}"
        for (state, new), events in ways.items()
    ]
    powered = ",".join(state.name for state in SafetyState if state in ENABLED)
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


def microservices() -> str:
    """Return the table of all MAVLink microservices."""
    context = Context(MavlinkConfig(), TelemetryRobot(), SimpleNamespace(count=0))
    rows = [_row(make(context)) for make in SERVICES]
    return "\n".join(
        ("| service | takes | answers | sends | capability |", "|---|---|---|---|---|", *rows)
    )


def _row(service: Microservice) -> str:
    """Return what a microservice says of itself."""
    columns = (
        [type(service).__name__],
        [common.mavlink_map[number].msgname for number in sorted(service.handles)],
        [_name("MAV_CMD", number) for number in sorted(service.commands)],
        [common.mavlink_map[stream.message_id].msgname for stream in service.streams()],
        [
            _name("MAV_PROTOCOL_CAPABILITY", 1 << bit)
            for bit in range(32)
            if service.capabilities >> bit & 1
        ],
    )
    return "| " + " | ".join(", ".join(words) for words in columns) + " |"


def _name(enum: str, value: int) -> str:
    """Return the name of an entry of a MAVLink enumeration, without that of the enumeration."""
    entries = ardupilotmega.enums[enum] if value not in common.enums[enum] else common.enums[enum]
    return str(entries[value].name).removeprefix(f"{enum}_")


def parameters() -> str:
    """Return the table of all parameters."""
    rows = ["| parameter | in the robot's file | range | changes |", "|---|---|---|---|"]
    rows += [
        f"| {each.name} | `{each.key}` | {each.low:g} to {each.high:g} | {each.change.value} |"
        for each in PARAMETERS
    ]
    return "\n".join(rows)


@dataclass(frozen=True, slots=True)
class Part:
    """One generated part of one page."""

    page: Path
    write: Callable[[], str]

    def put_into(self, text: str) -> str:
        """Return `text` with the present part between its marks.

        Raises
        ------
        ValueError
            Where the marks are not there once each.
        """
        if text.count(BEGIN) != 1 or text.count(END) != 1:
            raise ValueError(f"{self.page}: {BEGIN!r} and {END!r} must stand there once each")
        before, rest = text.split(BEGIN)
        _, after = rest.split(END)
        return f"{before}{BEGIN}\n{self.write()}\n{END}{after}"


STATES = Part(DOCS / "safety.md", diagram)
FAULTS = Part(DOCS / "faults.md", describe)
MICROSERVICES = Part(DOCS / "mavlink.md", microservices)
TABLE = Part(DOCS / "parameters.md", parameters)


def main() -> int:
    """Rewrite the pages."""
    for part in (STATES, FAULTS, MICROSERVICES, TABLE):
        text = part.page.read_text(encoding="utf-8")
        part.page.write_text(part.put_into(text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
