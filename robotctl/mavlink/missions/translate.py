"""A MAVLink mission as a mission file of ours.

The first item is home, as ArduPilot has it, and no item of the mission.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.mavlink.frames import theta_from_yaw_ned
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.item import MissionItem, place_of
from robotctl.messages.requests import FARTHEST_M
from robotctl.model.geometry.se2 import SE2

HOME: Final = 1
"""Number of items before the mission's own: home."""
_POINTS: Final = frozenset({common.MAV_CMD_NAV_WAYPOINT, common.MAV_CMD_NAV_LOITER_TIME})
PLACES: Final = _POINTS | {common.MAV_CMD_NAV_LOITER_TURNS}
_LONGEST_S: Final = 86_400.0
_FASTEST_M_S: Final = 100.0
_MOST_TIMES: Final = 32_767
"""Upper bounds of a wait [s], of a speed [m/s], and of the times of a jump."""
_UNSUPPORTED: Final[int] = common.MAV_MISSION_UNSUPPORTED
_FRAME: Final[int] = common.MAV_MISSION_UNSUPPORTED_FRAME
_PARAMS: Final = (
    common.MAV_MISSION_INVALID_PARAM1,
    common.MAV_MISSION_INVALID_PARAM2,
    common.MAV_MISSION_INVALID_PARAM3,
    common.MAV_MISSION_INVALID_PARAM4,
)
_AXES: Final = (common.MAV_MISSION_INVALID_PARAM5_X, common.MAV_MISSION_INVALID_PARAM6_Y)


class BadItem(Exception):  # noqa: N818 - what it is, not that it went wrong
    """An item that the robot cannot drive: its number, MAV_MISSION_RESULT, and why."""

    def __init__(self, seq: int, result: int, why: str) -> None:
        super().__init__(f"item {seq}: {why}")
        self.seq = seq
        self.why = why
        self.result = result


class MissionContext(NamedTuple):
    """Context on which the meaning of an item depends."""

    home: SE2
    """Start of the robot, in `world`."""
    origin: Origin | None
    """Origin of `world` on the globe; None: global frames mean nothing."""
    plans: bool
    """Whether the robot plans its way; else it drives straight to a place."""
    hidden: int = 0
    """Number of items before the first that the station knows: its numbers are smaller by this."""


@dataclass(slots=True)
class Translation:
    """A mission of ours.

    Parameters
    ----------
    items
        Tables of the mission file.
    sources
        Of each of them, the number of the MAVLink item that it is from.
    notes
        What is left out, for people.
    """

    items: list[dict[str, Any]] = field(default_factory=list)
    sources: list[int] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def first_from(sources: Sequence[int], seq: int) -> int | None:
    """Return the index of the first item that is from a MAVLink item or a later one."""
    return next((k for k, source in enumerate(sources) if source >= seq), None)


def check_item(item: MissionItem, seq: int, around: MissionContext) -> None:
    """Check a single item. Home is not driven: only its numbers count.

    Raises
    ------
    BadItem
        If the robot cannot drive it.
    """
    if seq < HOME:
        check_params(item, seq)
        check_altitude(item, seq)
    else:
        _Translator(around).add(item, seq)


def check_params(item: MissionItem, seq: int) -> None:
    """Check that no parameter is infinite; no number (nan) is the default of most.

    Raises
    ------
    BadItem
        If one is.
    """
    for number, (value, result) in enumerate(zip(item.params, _PARAMS, strict=True), 1):
        if math.isinf(value):
            raise BadItem(seq, result, f"{value:g} found in param{number}, a number allowed")


def check_altitude(item: MissionItem, seq: int) -> None:
    """Check that the altitude of a place, which the robot ignores, is a number.

    Raises
    ------
    BadItem
        If it is none.
    """
    if not math.isfinite(item.z):
        why = f"{item.z:g} found in z, a number allowed"
        raise BadItem(seq, common.MAV_MISSION_INVALID_PARAM7, why)


def translate(items: Sequence[MissionItem], around: MissionContext) -> Translation:
    """Return what the items after home mean.

    Raises
    ------
    BadItem
        If the robot cannot drive one of them.
    """
    translator = _Translator(around)
    for seq, item in enumerate(items[HOME:], HOME):
        translator.add(item, seq)
    done = translator.done
    for seq, index, target in translator.jumps:
        to = first_from(done.sources, target)
        if to is None or not HOME <= target < len(items):
            first, last = HOME - around.hidden, len(items) - 1 - around.hidden
            raise BadItem(
                seq,
                common.MAV_MISSION_INVALID_PARAM1,
                f"jumps to {target - around.hidden}, {first} to {last} allowed, "
                "and something to drive there",
            )
        done.items[index]["to"] = to + 1
    if not done.items:
        raise BadItem(HOME, common.MAV_MISSION_INVALID, "nothing to drive")
    return done


class _Translator:
    """Goes through the items; a change of speed counts for those after it."""

    def __init__(self, around: MissionContext) -> None:
        self.done = Translation()
        self.jumps: list[tuple[int, int, int]] = []
        """Number of each jump, its index among the items of ours, and its target's number."""
        self._around = around
        self._speed_m_s: float | None = None

    def add(self, item: MissionItem, seq: int) -> None:
        """Translate one item."""
        check_params(item, seq)
        translate_item = _COMMANDS.get(item.command)
        if translate_item is None:
            raise BadItem(seq, _UNSUPPORTED, f"command {item.command} is not supported")
        translate_item(self, item, seq)

    def drive_to(self, item: MissionItem, seq: int) -> None:
        """Drive to the item's place, and wait there."""
        place = bounded_place(item, seq, self._around.origin)
        self._drive_to(seq, *place, self._heading_deg(item))
        self._wait(seq, item.params[0])

    def circle(self, item: MissionItem, seq: int) -> None:
        """Drive round the item's place: clockwise where the radius is positive."""
        x_m, y_m = bounded_place(item, seq, self._around.origin)
        turns, radius_m = item.params[0], item.params[2]
        if not 0.0 < turns <= _MOST_TIMES:
            why = f"{turns:g} turns found, above 0 to {_MOST_TIMES} allowed"
            raise BadItem(seq, common.MAV_MISSION_INVALID_PARAM1, why)
        if not 0.0 < abs(radius_m) < FARTHEST_M:
            why = f"radius {radius_m:g} m found, above 0 and below {FARTHEST_M:g} m allowed"
            raise BadItem(seq, common.MAV_MISSION_INVALID_PARAM3, f"{why}, or its negative")
        table: dict[str, object] = {"kind": "circle", "x_m": x_m, "y_m": y_m, "turns": turns}
        table |= {"radius_m": abs(radius_m), "side": "right" if radius_m > 0.0 else "left"}
        self._append(seq, **table, **self._speed)

    def drive_home(self, item: MissionItem, seq: int) -> None:  # noqa: ARG002
        """Drive to where the robot started."""
        home = self._around.home
        self._drive_to(seq, home.x_m, home.y_m, None)

    def wait(self, item: MissionItem, seq: int) -> None:
        """Stand for a while."""
        self._wait(seq, item.params[0])

    def ignore_camera(self, item: MissionItem, seq: int) -> None:  # noqa: ARG002
        """Leave out a command that turns a camera: the robot's does not turn."""
        number = seq - self._around.hidden
        self.done.notes.append(f"item {number}: the camera does not turn, ignored")

    def _append(self, seq: int, **table: object) -> None:
        self.done.items.append(table)
        self.done.sources.append(seq)

    def _drive_to(self, seq: int, x_m: float, y_m: float, heading_deg: float | None) -> None:
        kind = "goto" if self._around.plans else "straight_to"
        table: dict[str, object] = {"kind": kind, "x_m": x_m, "y_m": y_m}
        if heading_deg is not None and self._around.plans:
            table["heading_deg"] = heading_deg
        self._append(seq, **table, **self._speed)

    @property
    def _speed(self) -> dict[str, float]:
        return {} if self._speed_m_s is None else {"speed_m_s": self._speed_m_s}

    def _wait(self, seq: int, seconds: float) -> None:
        """Stand for a while; 0 and no number: not at all."""
        if math.isnan(seconds) or seconds == 0.0:
            return
        if not 0.0 < seconds <= _LONGEST_S:
            why = f"{seconds:g} s found, 0 to {_LONGEST_S:g} allowed"
            raise BadItem(seq, common.MAV_MISSION_INVALID_PARAM1, why)
        self._append(seq, kind="wait", duration_s=seconds)

    def change_speed(self, item: MissionItem, seq: int) -> None:
        """Take another speed; -1 is the robot's own again, -2 no change."""
        speed_m_s = item.params[1]
        if speed_m_s == -2.0:
            return
        if speed_m_s == -1.0:
            self._speed_m_s = None
        elif 0.0 < speed_m_s <= _FASTEST_M_S:
            self._speed_m_s = speed_m_s
        else:
            why = f"{speed_m_s:g} m/s found, above 0 to {_FASTEST_M_S:g} allowed, or -1, -2"
            raise BadItem(seq, common.MAV_MISSION_INVALID_PARAM2, why)

    def jump(self, item: MissionItem, seq: int) -> None:
        """Go on with another item, a number of times; -1: always."""
        target, times = item.params[:2]
        if math.isnan(target) or target != int(target):
            why = f"jumps to {target:g}, a whole number allowed"
            raise BadItem(seq, common.MAV_MISSION_INVALID_PARAM1, why)
        if math.isnan(times) or not -1.0 <= times <= _MOST_TIMES or times != int(times):
            why = f"jumps {times:g} times, -1 to {_MOST_TIMES} allowed"
            raise BadItem(seq, common.MAV_MISSION_INVALID_PARAM2, why)
        if times == 0.0:
            return
        self.jumps.append((seq, len(self.done.items), int(target)))
        table: dict[str, object] = {"kind": "jump", "to": 0}
        if times > 0.0:
            table["times"] = int(times)
        self._append(seq, **table)

    @staticmethod
    def _heading_deg(item: MissionItem) -> float | None:
        """Return the heading in `world` [deg]; 0 and no number are any, as for ArduPilot."""
        yaw_deg = item.params[3]
        if math.isnan(yaw_deg) or yaw_deg == 0.0:
            return None
        return math.degrees(theta_from_yaw_ned(math.radians(yaw_deg)))


_COMMANDS: Final[dict[int, Callable[[_Translator, MissionItem, int], None]]] = {
    **dict.fromkeys(_POINTS, _Translator.drive_to),
    common.MAV_CMD_NAV_LOITER_TURNS: _Translator.circle,
    common.MAV_CMD_NAV_RETURN_TO_LAUNCH: _Translator.drive_home,
    common.MAV_CMD_NAV_DELAY: _Translator.wait,
    common.MAV_CMD_CONDITION_DELAY: _Translator.wait,
    common.MAV_CMD_DO_CHANGE_SPEED: _Translator.change_speed,
    common.MAV_CMD_DO_JUMP: _Translator.jump,
    common.MAV_CMD_DO_SET_ROI: _Translator.ignore_camera,
    common.MAV_CMD_DO_SET_ROI_LOCATION: _Translator.ignore_camera,
    common.MAV_CMD_DO_SET_ROI_NONE: _Translator.ignore_camera,
}
"""Translation of each command; another one is one method and one line here."""


def bounded_place(item: MissionItem, seq: int, origin: Origin | None) -> tuple[float, float]:
    """Return x and y of an item in `world` [m].

    Raises
    ------
    BadItem
        If its frame means nothing here, or the place is too far away or no number.
    """
    place = place_of(item, origin)
    if place is None:
        why = "the map has no origin on the globe" if item.is_global else "it is not supported"
        raise BadItem(seq, _FRAME, f"frame {item.frame}: {why}")
    for value, result in zip(place, _AXES, strict=True):
        if not abs(value) < FARTHEST_M:
            raise BadItem(seq, result, f"{value:.0f} m away, less than {FARTHEST_M:g} allowed")
    check_altitude(item, seq)
    return place
