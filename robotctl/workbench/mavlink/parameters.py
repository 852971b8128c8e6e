"""Parameters of a running robot: read, set, saved to files and compared with them."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.errors import ConfigError, LinkError, RobotctlError
from robotctl.mavlink.parameters.parameter import REAL32, shortest, single
from robotctl.mavlink.personality import number_of, whole_of
from robotctl.messages.mavlink_port import Message
from robotctl.runtime.storage.atomic_file import write_whole
from robotctl.toml_source import nearest
from robotctl.workbench.mavlink.companion import Companion

AGAIN_S: Final = 0.4
"""Interval between tries of an unanswered request [s]."""
TRIES: Final = 12
"""Maximum tries of a request."""
MOST_GAPS: Final = 100
"""Asked for at a time."""
_REASON_S: Final = 0.3
"""The reason comes with the refusal, or right after it [s]."""
_QGC_COLUMNS: Final = 5


class ParameterRefusedError(RobotctlError):
    """The robot has no such parameter, or does not take a value."""


class Reading(NamedTuple):
    """A parameter as the robot tells it."""

    value: float
    kind: int
    """MAV_PARAM_TYPE."""

    @property
    def text(self) -> str:
        """The value, as people write it."""
        return f"{shortest(self.value):g}" if self.kind == REAL32 else f"{self.value:.0f}"


class ParameterClient:
    """Reads and sets the parameters of one robot."""

    def __init__(self, robot: Companion) -> None:
        self._robot = robot

    def read_all(self) -> dict[str, Reading]:
        """Return all parameters, by name, in the robot's order.

        Raises
        ------
        LinkError
            If they do not come.
        """
        found: dict[int, tuple[str, Reading]] = {}
        count = -1
        self._robot.send(common.MAVLink_param_request_list_message)
        tries = 0
        while len(found) != count:
            before = len(found)
            for message in self._values(AGAIN_S):
                count = message.param_count
                found[message.param_index] = message.param_id, self._reading(message)
                if len(found) == count:
                    break
            tries = 0 if len(found) > before else tries + 1
            if tries > TRIES:
                raise LinkError(f"{len(found)} of {max(count, 0)} parameters have come, then none")
            if count < 0:
                self._robot.send(common.MAVLink_param_request_list_message)
            elif len(found) == before:
                self._ask_for_gaps([index for index in range(count) if index not in found])
        return dict(found[index] for index in sorted(found))

    def _ask_for_gaps(self, gaps: list[int]) -> None:
        for index in gaps[:MOST_GAPS]:
            self._robot.send(_request(b"", index))

    def _values(self, seconds: float) -> Iterator[Message]:
        """Yield PARAM_VALUE of the coming time [s]; a steady stream of them makes it longer."""
        quiet_s = self._robot.now_s + seconds
        while self._robot.now_s < quiet_s:
            for message in self._robot.hear(seconds / 4.0):
                is_value = message.get_msgId() == common.MAVLINK_MSG_ID_PARAM_VALUE
                # Some send 65535 where they tell what was set: that is no place in the list.
                if is_value and message.param_index < message.param_count:
                    quiet_s = self._robot.now_s + seconds
                    yield message

    def get(self, name: str) -> Reading:
        """Return one parameter.

        Raises
        ------
        ParameterRefusedError
            If there is none of this name; with the nearest.
        LinkError
            If no answer comes.
        """
        for _ in range(TRIES):
            self._robot.send(_request(name.encode("ascii", "replace"), -1))
            answer = self._answer(name, AGAIN_S)
            if answer is None:
                continue
            if answer.get_msgId() == common.MAVLINK_MSG_ID_PARAM_VALUE:
                return self._reading(answer)
            raise ParameterRefusedError(
                f"{name}: no such parameter{nearest(name, [*self.read_all()])}"
            )
        raise LinkError(f"{name}: no answer")

    def set(self, name: str, value: float) -> tuple[Reading, str]:
        """Set a parameter; return what it is now, and what the robot says of it, "" for nothing.

        Raises
        ------
        ParameterRefusedError
            If the robot does not take it; with its reason.
        LinkError
            If no answer comes.
        """
        kind = self.get(name).kind
        is_whole = kind != REAL32 and not self._robot.is_ardupilot
        sent = number_of(int(value)) if is_whole and value == int(value) else value
        self._robot.texts.clear()
        for _ in range(TRIES):
            self._robot.send(
                lambda system, component: common.MAVLink_param_set_message(
                    system, component, name.encode(), sent, kind
                )
            )
            answer = self._answer(name, AGAIN_S)
            if answer is None:
                continue
            said = self._said(name)
            if answer.get_msgId() == common.MAVLINK_MSG_ID_PARAM_VALUE:
                reading = self._reading(answer)
                if reading.value == single(value):
                    return reading, said
            raise ParameterRefusedError(said or f"{name}: {value:g} is refused")
        raise LinkError(f"{name}: no answer")

    def _reading(self, message: Message) -> Reading:
        value, kind = message.param_value, message.param_type
        return Reading(value if self._robot.is_ardupilot else whole_of(value, kind), kind)

    def _answer(self, name: str, seconds: float) -> Message | None:
        """Return the answer about a parameter within a time [s]; None: there is none."""
        kinds = common.MAVLINK_MSG_ID_PARAM_VALUE, common.MAVLINK_MSG_ID_PARAM_ERROR
        for message in self._robot.hear(seconds):
            if message.get_msgId() in kinds and message.param_id == name:
                return message
        return None

    def _said(self, name: str) -> str:
        """Return what the robot says of a parameter, without the first word."""
        start = f"Parameter {name}"
        for _ in self._robot.hear(_REASON_S):
            pass  # a long text comes in parts
        said = [text for text in self._robot.texts if text.startswith(start)]
        return said[-1].removeprefix("Parameter ") if said else ""


def _request(name: bytes, index: int) -> Callable[[int, int], Message]:
    """Return what makes PARAM_REQUEST_READ for a system and component."""
    return lambda system, component: common.MAVLink_param_request_read_message(
        system, component, name, index
    )


def matching(readings: Mapping[str, Reading], pattern: str) -> dict[str, Reading]:
    """Return the parameters whose names match a pattern with `*` and `?`; "" is all.

    Raises
    ------
    ParameterRefusedError
        If there are none; with the nearest name.
    """
    found = {
        name: reading
        for name, reading in readings.items()
        if not pattern or fnmatch.fnmatchcase(name, pattern.upper())
    }
    if pattern and not found:
        hint = nearest(pattern.upper(), [*readings])
        raise ParameterRefusedError(f"{pattern}: no such parameter{hint}")
    return found


def save(path: Path, readings: Mapping[str, Reading]) -> None:
    """Write parameters as lines of name and value, as MAVProxy and Mission Planner read them.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    """
    lines = [f"{name:<16} {reading.text}" for name, reading in readings.items()]
    try:
        write_whole(path, "\n".join(lines) + "\n")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def read(path: Path) -> dict[str, float]:
    """Return the values of a file: lines of name and value, or QGroundControl's five columns.

    Raises
    ------
    ConfigError
        With one line for each error.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    found: dict[str, float] = {}
    wrong: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) == _QGC_COLUMNS:
            words = words[2:4]
        try:
            name, value = words
            found[name] = float(value)
        except ValueError:
            wrong.append(f"{path}:{number}: {line!r} found, NAME VALUE allowed")
    if wrong:
        raise ConfigError("\n".join(wrong))
    return found


class Difference(NamedTuple):
    """A parameter that is another one in a file; None: it is not there."""

    name: str
    robot: str | None
    file: str | None


def differences(readings: Mapping[str, Reading], wanted: Mapping[str, float]) -> list[Difference]:
    """Return where robot and file differ; what only the robot has is no difference."""
    found = []
    for name, value in wanted.items():
        reading = readings.get(name)
        if reading is None:
            found.append(Difference(name, None, f"{value:g}"))
        elif reading.value != single(value):
            text = Reading(single(value), reading.kind).text
            found.append(Difference(name, reading.text, text))
    return found
