"""Missions: upload, download, and how far the robot is.

Item 0 is home, as ArduPilot has it; stations to which the robot is none do not see it.
"""

from __future__ import annotations

from typing import ClassVar, Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.command import ACCEPTED, DENIED, TEMPORARILY_REJECTED, Command
from robotctl.mavlink.context import Context, Request
from robotctl.mavlink.missions.file import MissionPlan, UploadedMission, mission_file
from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.missions.of_file import plan_of_file
from robotctl.mavlink.missions.single_items import guided_place, hidden_items, home_item
from robotctl.mavlink.missions.transfer import MISSION, Transfer
from robotctl.mavlink.missions.translate import (
    HOME,
    PLACES,
    MissionContext,
    check_item,
    translate,
)
from robotctl.messages.control import Mode, NavigationState, PositionTarget
from robotctl.messages.mavlink_port import Message, Peer, source
from robotctl.messages.mission import JumpToItem, LoadMission

SET_CURRENT: Final[int] = common.MAV_CMD_DO_SET_MISSION_CURRENT
CURRENT_HZ: Final = 1.0
"""Rate of MISSION_CURRENT [Hz]."""


class Missions(Transfer[MissionPlan]):
    """Takes missions from one ground station at a time, and gives them to all."""

    handles = Transfer.handles | {common.MAVLINK_MSG_ID_MISSION_SET_CURRENT}
    commands = frozenset({SET_CURRENT})
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    kind = MISSION
    word = "mission"
    first = HOME

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._reached = 0
        """Items of ours that the robot has passed."""
        self._is_foreign, self._told_by = False, context.origin
        """Whether the mission did not come over MAVLink, and the origin by which it is told."""
        self._take[common.MAVLINK_MSG_ID_MISSION_SET_CURRENT] = self._set_current

    def streams(self) -> tuple[Stream, ...]:
        """Return MISSION_CURRENT."""
        group = common.MAV_DATA_STREAM_EXTENDED_STATUS
        return (Stream(common.MAVLINK_MSG_ID_MISSION_CURRENT, self._current, CURRENT_HZ, group),)

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take DO_SET_MISSION_CURRENT: param1 is the item's number."""
        seq = command.whole(0)
        if seq is None:
            return DENIED
        if objection := self._objection(command.peer, command.sender, now_ns):
            self.say(now_ns, objection)
            return TEMPORARILY_REJECTED
        return ACCEPTED if self._jump(seq + self.hidden, now_ns) else DENIED

    def step(self, now_ns: int) -> None:
        """Go on with transfers; say what the robot has reached."""
        super().step(now_ns)
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is not None and not self._offers.are_pending:
            self._follow(navigation)
        if navigation is not None and self._is_loaded(navigation):
            self._tell_reached(navigation)

    def _follow(self, navigation: NavigationState) -> None:
        """Let stations read a mission that the robot has from elsewhere: a file, or the page."""
        view, origin = self._context.mission, self._context.origin
        if view is None or not view.crc or view.crc != navigation.mission_crc:
            return
        if view.crc != self._plan.crc or (self._is_foreign and origin != self._told_by):
            self.adopt(plan_of_file(view.content, origin), navigation)
            self._is_foreign, self._told_by = True, origin

    # What a mission is.

    def read(self, content: bytes) -> MissionPlan:
        """Return the mission of a file."""
        return plan_of_file(content, self._context.origin) if content else MissionPlan()

    def check(self, item: MissionItem, seq: int) -> None:
        """Check a single item."""
        check_item(item, seq, _around(self._context))

    def plan_of(self, items: list[MissionItem]) -> tuple[MissionPlan, list[str]]:
        """Return the mission of ours."""
        meaning = translate(items, _around(self._context))
        by_globe = any(each.is_global and each.command in PLACES for each in items[HOME:])
        origin = self._context.origin if by_globe else None
        kept = UploadedMission(tuple(items), tuple(meaning.sources), origin)
        content = mission_file(kept, meaning, self._context.home)
        return MissionPlan(kept, content), meaning.notes

    def request(self, plan: MissionPlan, file: str, now_ns: int) -> Request:
        """Return the request to take a mission."""
        return LoadMission(now_ns, file, plan.content)

    def is_taken(self, plan: MissionPlan, navigation: NavigationState) -> bool:
        """Return whether it is the robot's mission; none: whether that has none."""
        return navigation.mission_crc == plan.crc if plan.crc else not navigation.items

    def may_offer(self, navigation: NavigationState) -> bool:
        """Return whether the robot has started without a mission."""
        return not navigation.items

    def adopt(self, plan: MissionPlan, navigation: NavigationState) -> None:
        """Note that a mission is navigation's."""
        super().adopt(plan, navigation)
        self._is_foreign = False
        self._reached = navigation.item

    def listed(self, now_ns: int) -> tuple[MissionItem, ...]:
        """Return the items; none while navigation has another mission, or is silent."""
        items = self._plan.items if self._is_there(now_ns) else ()
        return (home_item(self._context), *items[HOME:]) if items else ()

    @property
    def hidden(self) -> int:
        """Home, where the personality has it in no mission."""
        return hidden_items(self._context)

    def always(self) -> tuple[MissionItem, ...]:
        """Return home: ArduPilot's may always be read, and dronekit waits for it."""
        return () if self.hidden else (home_item(self._context),)

    def take_single(self, message: Message, peer: Peer, now_ns: int) -> int:
        """Drive to a place at once, in GUIDED: `simple_goto` of dronekit, `guided` of MAVProxy."""
        result, why, place = guided_place(self._context, message, peer, now_ns)
        if why:
            self.say(now_ns, f"a single item: {why}")
        if place is not None:
            self._context.requests.append(PositionTarget(now_ns, *place))
        return result

    def hidden_items(self) -> list[MissionItem]:
        """Return home, if it is hidden."""
        return [home_item(self._context)] * self.hidden

    # How far it is.

    def _is_loaded(self, navigation: NavigationState) -> bool:
        """Return whether the robot's mission is the one that came over MAVLink."""
        return bool(self._plan.crc) and navigation.mission_crc == self._plan.crc

    def _is_there(self, now_ns: int) -> bool:
        navigation = self._context.fresh_navigation(now_ns)
        return navigation is not None and self._is_loaded(navigation)

    def seq(self, now_ns: int) -> int:
        """Return the number of the present item; home, 0, without a mission of MAVLink."""
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is None or not self._is_loaded(navigation):
            return 0
        return self._plan.seq_of(navigation.item)

    def _set_current(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take MISSION_SET_CURRENT, which is answered by MISSION_CURRENT."""
        why = self._objection(peer, source(message), now_ns)
        result = common.MAV_MISSION_DENIED
        if not why and not self._jump(message.seq + self.hidden, now_ns):
            why = f"there is no item {message.seq} to go on with"
            result = common.MAV_MISSION_INVALID_SEQUENCE
        if why:
            self.say(now_ns, why)
            self.acknowledge(source(message), peer, result)

    def _objection(self, peer: Peer, sender: tuple[int, int], now_ns: int) -> str:
        """Return why no item may be chosen now; empty: it may.

        A late copy of such a request must not set a robot off that has come to its end in AUTO.
        """
        if not self._is_there(now_ns):
            return "none of MAVLink's is loaded"
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is not None and navigation.mode is Mode.AUTO:
            if navigation.mission_completed or navigation.mission_failed:
                return "it has ended; choose HOLD, an item, and AUTO"
            return self._context.held_back.objection(peer, sender, now_ns)
        return ""

    def _jump(self, seq: int, now_ns: int) -> bool:
        """Ask to go on with an item; home is the first. Return whether there is one."""
        to = self._plan.first_of(max(seq, HOME))
        if to is None or not self.hidden <= seq < len(self._plan.items):
            return False
        self._context.requests.append(JumpToItem(now_ns, to + 1))
        return True

    def _tell_reached(self, navigation: NavigationState) -> None:
        """Say to all which items were passed since the last step."""
        passed, self._reached = self._reached, navigation.item
        sources = self._plan.sources
        here = self._plan.seq_of(navigation.item) if navigation.item < len(sources) else None
        for seq in sorted({sources[k] for k in range(passed, min(navigation.item, len(sources)))}):
            if seq != here:
                reached = common.MAVLink_mission_item_reached_message(seq - self.hidden)
                self._context.links.broadcast(reached)

    def _current(self, now_ns: int) -> list[Message]:
        """Return MISSION_CURRENT."""
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is None:
            return []
        state = _state_of(navigation)
        mode = 1 if navigation.mode is Mode.AUTO else 2
        total = max(len(self._plan.items) - HOME, 0) if self._is_there(now_ns) else 0
        seq = max(self.seq(now_ns) - self.hidden, 0)
        return [common.MAVLink_mission_current_message(seq, total, state, mode)]


def _around(context: Context) -> MissionContext:
    """Return what a mission is translated with."""
    return MissionContext(context.home, context.origin, context.robot.plans, hidden_items(context))


def _state_of(navigation: NavigationState) -> int:
    """Return MISSION_STATE."""
    if not navigation.items:
        return int(common.MISSION_STATE_NO_MISSION)
    if navigation.mission_completed:
        return int(common.MISSION_STATE_COMPLETE)
    if navigation.mode is Mode.AUTO and not navigation.mission_failed:
        return int(common.MISSION_STATE_ACTIVE)
    begun = navigation.item > 0 or navigation.item_s_m > 0.0
    return int(common.MISSION_STATE_PAUSED if begun else common.MISSION_STATE_NOT_STARTED)
