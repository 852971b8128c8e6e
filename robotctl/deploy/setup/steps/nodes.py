"""Step: all drives and nodes are on their buses, with the right ids and counts."""

from __future__ import annotations

import re
from collections.abc import Generator
from typing import Final

from robotctl.app.processes.robot import make_parts
from robotctl.config.file_edit import Change
from robotctl.deploy.doctor_nodes import check_node
from robotctl.deploy.setup.bench import Bench, with_node_id
from robotctl.deploy.setup.dialogue import (
    NO_CHANGES,
    Answer,
    Ask,
    Changes,
    Kind,
    Script,
    Tell,
    Topic,
)
from robotctl.deploy.setup.steps.asking import again_or_give_up, confirm
from robotctl.drivers.can.drives.motor_drive import MotorDrive
from robotctl.drivers.can.drives.native.settings import COUNTS_DIFFER
from robotctl.errors import ConfigError, InvalidValue

_COUNTS: Final = re.compile(
    re.escape(COUNTS_DIFFER).replace(r"\{found\}", r"(\d+)").replace(r"\{wanted\}", r"\d+")
)
_NUMBERS: Final = range(255)
"""Node ids of all protocols."""
_AT_ONCE: Final = 32
"""Node ids listened to at once: the kernel filters by at most 512 identifiers."""
_LISTEN_S: Final = 0.4
"""Listening time [s], more than four heartbeats."""


def run(bench: Bench) -> Script:
    """Check that all are in service; find the true ids of silent drives."""
    while True:
        yield Tell("Looking for all drives and sensor nodes …")
        statuses = bench.commission()
        for status in statuses:
            finding = check_node(status, None)
            yield Tell(f"{finding.check}: {finding.found}")
        if not any(status.problem for status in statuses):
            return NO_CHANGES
        changes = yield from _put_right(bench)
        if changes:
            return changes
        first = next(check_node(each, None) for each in statuses if each.problem)
        yield from again_or_give_up(first.found, first.fix)


def _put_right(bench: Bench) -> Generator[Ask | Tell, Answer, Changes]:
    """Return the corrections of the file, as far as they can be found."""
    changes: list[Change] = []
    for number, (motor, drive, _) in enumerate(bench.drives):
        status = drive.status
        if counts := _COUNTS.search(status.problem):
            text = f"Write the {counts[1]} counts that {motor.name} has into the robot's file?"
            if (yield from confirm(Topic.COUNTS, text, motor.name)):
                changes.append(Change(("drive", "counts_per_revolution"), int(counts[1])))
        elif not status.boots and hasattr(motor, "node_id"):
            node_id = yield from _ask_number(bench, number)
            if node_id is not None:
                changes.append(Change(("motor", number, "node_id"), node_id))
    return tuple({each.key: each for each in changes}.values())


def _ask_number(bench: Bench, number: int) -> Generator[Ask | Tell, Answer, int | None]:
    """Search for a drive under other ids, and ask for its true one; None: unknown."""
    motor = bench.config.motors[number]
    found = find_numbers(bench, number)
    if found:
        listed = " and ".join(map(str, found))
        yield Tell(f"A drive of kind {motor.kind} answers as node {listed}.")
        text = f"Which of them is {motor.name}, or none?"
        choices = (*map(str, found), "none")
        ask = Ask(Topic.NUMBER, text, Kind.CHOICE, choices, choices[0], motor.name)
        answer = yield ask
        return None if answer == "none" else int(answer)
    text = (
        f"No other drive of kind {motor.kind} is heard. Which number does {motor.name} have, as "
        "its maker's tool shows it? -1: not known."
    )
    answer = yield Ask(Topic.NUMBER, text, Kind.NUMBER, default="-1", subject=motor.name)
    node_id = int(answer)
    try:
        with_node_id(bench.config, number, node_id)
    except InvalidValue as error:
        if node_id != -1:
            yield Tell(str(error))
        return None
    return node_id


def find_numbers(bench: Bench, number: int) -> tuple[int, ...]:
    """Return ids, not in the file, under which drives of a motor's kind answer.

    Each is queried once like the drive itself; nothing is set and nothing moves.
    """
    motor = bench.config.motors[number]
    bus = motor.bus or bench.config.buses[0].name
    known = {
        node_id
        for each, drive, _ in bench.drives
        if (each.kind, each.bus) == (motor.kind, motor.bus) and drive.status.boots
        for node_id in each.node_ids
    }
    candidates = dict(_candidates(bench, number, known))
    numbers = list(candidates)
    for first in range(0, len(numbers), _AT_ONCE):
        _listen(bench, bus, [candidates[each] for each in numbers[first : first + _AT_ONCE]])
    return tuple(each for each, drive in candidates.items() if drive.status.boots)


def _candidates(
    bench: Bench, number: int, known: set[int]
) -> Generator[tuple[int, MotorDrive], None, None]:
    """Yield each possible id of the drive, and the drive with that id."""
    for node_id in _NUMBERS:
        try:
            config = with_node_id(bench.config, number, node_id)
        except InvalidValue:
            continue
        if not known.isdisjoint(config.motors[number].node_ids):
            continue
        try:
            parts = make_parts(config, bench.codec)
        except (ConfigError, InvalidValue):  # the frames of another node
            continue
        yield node_id, parts.drives[number].drive


def _listen(bench: Bench, bus: str, drives: list[MotorDrive]) -> None:
    """Query drives by their ids, and listen for answers."""
    identifiers = {number for drive in drives for number in drive.handlers}
    ports = bench.buses.open({bus: identifiers})
    try:
        end_ns = bench.now_ns + round(_LISTEN_S * 1e9)
        calls = list(drives)
        while bench.now_ns < end_ns or calls:
            bench.rest()
            if calls:
                calls.pop().serve(ports[bus].send, bench.now_ns)
            for arbitration_id, data, stamp_ns in ports[bus].receive():
                for drive in drives:
                    handler = drive.handlers.get(arbitration_id)
                    if handler is not None:
                        handler(data, stamp_ns)
        for drive in drives:
            drive.check(bench.now_ns)
    finally:
        ports[bus].close()
