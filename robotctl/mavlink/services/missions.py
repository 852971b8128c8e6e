"""Missions: upload, download, and how far the robot is.

The plan changes only when a whole mission has come and navigation has taken it: an upload that ends
early leaves the old one. https://mavlink.io/en/services/mission.html. Item 0 is home, as ArduPilot
has it. Fences and rally points are none of the robot's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.command import ACCEPTED, DENIED, TEMPORARILY_REJECTED, Command
from robotctl.mavlink.context import Context
from robotctl.mavlink.frames import ned_from_enu
from robotctl.mavlink.missions.file import Kept, MissionPlan, mission_file, read_mission_file
from robotctl.mavlink.missions.item import MissionItem, item_of, message_of
from robotctl.mavlink.missions.translate import (
    HOME,
    PLACES,
    BadItem,
    Surroundings,
    check_item,
    translate,
)
from robotctl.mavlink.missions.upload import Upload
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode, NavigationState, Severity
from robotctl.messages.mavlink_port import Message, Peer, source
from robotctl.messages.mission import JumpToItem, LoadMission

MISSION: Final[int] = common.MAV_MISSION_TYPE_MISSION
ALL: Final[int] = common.MAV_MISSION_TYPE_ALL
SET_CURRENT: Final[int] = common.MAV_CMD_DO_SET_MISSION_CURRENT
MOST_ITEMS: Final = 1000
CURRENT_HZ: Final = 1.0
ANSWER_NS: Final = 1_500_000_000
"""Navigation has this long to take a mission [ns]."""
GUIDED_ITEM: Final = 2
"""`current` of an item that is no part of a mission but a place to go to at once."""


@dataclass(frozen=True, slots=True)
class _Offer:
    """A mission, or none, that navigation is asked to take."""

    plan: MissionPlan
    notes: list[str]
    partner: tuple[int, int]
    peer: Peer | None
    """None: it is offered again, and nobody waits for an answer."""
    asked_ns: int


class Missions(Microservice):
    """Takes missions from one ground station at a time, and gives them to all."""

    handles = frozenset(
        {
            common.MAVLINK_MSG_ID_MISSION_COUNT,
            common.MAVLINK_MSG_ID_MISSION_ITEM_INT,
            common.MAVLINK_MSG_ID_MISSION_ITEM,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
            common.MAVLINK_MSG_ID_MISSION_REQUEST,
            common.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
            common.MAVLINK_MSG_ID_MISSION_SET_CURRENT,
            common.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST,
        }
    )
    commands = frozenset({SET_CURRENT})
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_MISSION_INT

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._plan = MissionPlan()
        self._saved = context.missions.load()
        """The mission file of before this process began."""
        self._upload: Upload | None = None
        self._offer: _Offer | None = None
        self._answered: tuple[tuple[int, int], int] | None = None
        """Whose upload was answered last, and how: the answer may have been lost."""
        self._reached = 0
        """Items of ours that the robot has passed."""
        self._take = {
            common.MAVLINK_MSG_ID_MISSION_COUNT: self._begin,
            common.MAVLINK_MSG_ID_MISSION_ITEM_INT: self._take_item,
            common.MAVLINK_MSG_ID_MISSION_ITEM: self._take_item,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._tell_count,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_INT: self._tell_item,
            common.MAVLINK_MSG_ID_MISSION_REQUEST: self._tell_item,
            common.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._clear,
            common.MAVLINK_MSG_ID_MISSION_SET_CURRENT: self._set_current,
            common.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST: self._refuse,
        }

    def streams(self) -> tuple[Stream, ...]:
        """Return MISSION_CURRENT."""
        group = common.MAV_DATA_STREAM_EXTENDED_STATUS
        return (Stream(common.MAVLINK_MSG_ID_MISSION_CURRENT, self._current, CURRENT_HZ, group),)

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take a message of the protocol; of fences and rally points there are none."""
        kind = getattr(message, "mission_type", MISSION)
        wanted = (MISSION, ALL) if message.get_type() == "MISSION_CLEAR_ALL" else (MISSION,)
        if kind in wanted:
            self._take[message.get_msgId()](message, peer, now_ns)
        else:
            self._acknowledge(common.MAV_MISSION_UNSUPPORTED, source(message), peer, kind)

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take DO_SET_MISSION_CURRENT: param1 is the item's number."""
        seq = command.whole(0)
        if seq is None:
            return DENIED
        if objection := self._objection(command.peer, command.sender, now_ns):
            self._context.say(now_ns, f"Mission: {objection}")
            return TEMPORARILY_REJECTED
        return ACCEPTED if self._jump(seq, now_ns) else DENIED

    def step(self, now_ns: int) -> None:
        """Ask again for what has not come; answer what navigation has taken."""
        upload = self._upload
        if upload is not None and upload.asks_again(now_ns):
            if upload.is_given_up:
                self._upload = None
                self._context.say(now_ns, "Mission: the upload was given up, the old one stays")
                self._answer(common.MAV_MISSION_OPERATION_CANCELLED, upload)
            else:
                self._ask(upload)
        navigation = self._context.fresh_navigation(now_ns)
        if self._offer is not None:
            self._follow(self._offer, navigation, now_ns)
        elif self._saved and navigation is not None:
            self._offer_again(navigation, now_ns)
        if navigation is not None and self._is_loaded(navigation):
            self._tell_reached(navigation)

    # Upload.

    def _begin(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Begin an upload, or begin it anew."""
        partner = source(message)
        if self._is_busy(partner):
            self._acknowledge(common.MAV_MISSION_DENIED, partner, peer)
        elif message.count > MOST_ITEMS:
            self._context.say(now_ns, f"Mission: {message.count} items, {MOST_ITEMS} allowed")
            self._acknowledge(common.MAV_MISSION_NO_SPACE, partner, peer)
        elif message.count <= HOME:
            self._clear(message, peer, now_ns)
        else:
            self._upload = Upload(partner, peer, message.count, now_ns)
            self._ask(self._upload)

    def _is_busy(self, partner: tuple[int, int]) -> bool:
        """Return whether another station's upload, or navigation's answer, has to be waited for."""
        upload = self._upload
        return self._offer is not None or (upload is not None and upload.partner != partner)

    def _ask(self, upload: Upload) -> None:
        """Ask for the next item."""
        request = common.MAVLink_mission_request_int_message(
            *upload.partner, upload.wanted, MISSION
        )
        self._context.links.reply(request, upload.peer)

    def _take_item(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take an item if it is the next; repeat the answer to a sender that has not heard it."""
        partner, upload = source(message), self._upload
        if message.current >= GUIDED_ITEM:
            self._context.say(now_ns, "Mission: a single item is no mission; use GUIDED positions")
            self._acknowledge(common.MAV_MISSION_UNSUPPORTED, partner, peer)
        elif upload is None or upload.partner != partner:
            if self._answered is not None and self._answered[0] == partner:
                self._acknowledge(self._answered[1], partner, peer)
        elif message.seq == upload.wanted:
            self._add(upload, item_of(message), now_ns)
        elif message.seq > upload.wanted:
            self._ask(upload)

    def _add(self, upload: Upload, item: MissionItem, now_ns: int) -> None:
        """Add an item that is as it must be; offer the mission once it is whole."""
        try:
            if upload.wanted >= HOME:
                check_item(item, upload.wanted, self._around)
            upload.take(item, now_ns)
            if not upload.is_complete:
                self._ask(upload)
                return
            meaning = translate(upload.items, self._around)
        except BadItem as error:
            self._upload = None
            self._context.say(now_ns, f"Mission: {error}")
            self._answer(error.result, upload)
            return
        self._upload = None
        items = tuple(upload.items)
        by_globe = any(each.is_global and each.command in PLACES for each in items[HOME:])
        origin = self._context.origin if by_globe else None
        kept = Kept(items, tuple(meaning.sources), origin)
        plan = MissionPlan(kept, mission_file(kept, meaning, self._context.robot.home))
        self._ask_for(_Offer(plan, meaning.notes, upload.partner, upload.peer, now_ns))

    def _clear(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Ask navigation to have no mission."""
        if self._is_busy(source(message)):
            self._acknowledge(common.MAV_MISSION_DENIED, source(message), peer)
            return
        self._upload = None
        self._ask_for(_Offer(MissionPlan(), [], source(message), peer, now_ns))

    def _ask_for(self, offer: _Offer) -> None:
        """Ask navigation to take a mission, from the file in which it outlives a power cut."""
        self._offer = offer
        content = offer.plan.content
        path = self._context.missions.save(content) if content else ""
        if content and not path:
            self._context.say(offer.asked_ns, "Mission: cannot be saved, a restart will lose it")
        self._context.requests.append(LoadMission(offer.asked_ns, path, content))

    def _follow(self, offer: _Offer, navigation: NavigationState | None, now_ns: int) -> None:
        """Answer once navigation has taken a mission, or has not in time."""
        if navigation is not None and navigation.stamp_ns > offer.asked_ns:
            wanted = offer.plan.crc
            if navigation.mission_crc == wanted if wanted else not navigation.items:
                self._offer = None
                self._adopt(offer.plan, navigation)
                self._context.missions.keep(offer.plan.content)
                for note in offer.notes:
                    self._context.say(now_ns, f"Mission: {note}", Severity.NOTICE)
                self._answer(common.MAV_MISSION_ACCEPTED, offer)
                return
        if now_ns - offer.asked_ns > ANSWER_NS:
            why = "navigation is silent" if navigation is None else navigation.message
            self._context.say(now_ns, f"Mission not taken: {why}")
            self._offer = None
            self._context.missions.keep(self._plan.content)
            self._answer(common.MAV_MISSION_DENIED, offer)

    def _adopt(self, plan: MissionPlan, navigation: NavigationState) -> None:
        """Note that a mission is navigation's."""
        self._plan, self._reached = plan, navigation.item
        self._context.uses_origin = plan.kept.origin is not None

    def _offer_again(self, navigation: NavigationState, now_ns: int) -> None:
        """Offer the mission of before a power cut to a robot that has none."""
        content, self._saved = self._saved, b""
        kept = read_mission_file(content)
        if kept is None:
            return
        origin, plan = kept.origin, MissionPlan(kept, content)
        if origin is not None and self._context.origin not in {None, origin}:
            self._context.say(now_ns, "Mission: that of before is of another origin, left out")
            return
        self._context.origin = self._context.origin or origin
        if navigation.mission_crc == plan.crc:
            self._adopt(plan, navigation)
        elif not navigation.items:
            self._ask_for(_Offer(plan, [], (0, 0), None, now_ns))

    def _answer(self, result: int, asked: Upload | _Offer) -> None:
        """End an upload; the same answer goes to who repeats the last item."""
        if asked.peer is not None:
            self._answered = asked.partner, result
            self._acknowledge(result, asked.partner, asked.peer)

    def _acknowledge(
        self, result: int, partner: tuple[int, int], peer: Peer, kind: int = MISSION
    ) -> None:
        ack = common.MAVLink_mission_ack_message(*partner, result, kind)
        self._context.links.reply(ack, peer)

    def _refuse(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Refuse a part of a mission: what is driven is always one that came whole."""
        self._context.say(now_ns, "Mission: parts are not taken, upload the whole")
        self._acknowledge(common.MAV_MISSION_UNSUPPORTED, source(message), peer)

    # Download.

    def _tell_count(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Say how many items there are; none while navigation has another mission, or no answer."""
        count = len(self._plan.items) if self._is_there(now_ns) else 0
        answer = common.MAVLink_mission_count_message(*source(message), count, MISSION)
        self._context.links.reply(answer, peer)

    def _tell_item(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Send one item in the form in which it is asked for."""
        items = self._plan.items if self._is_there(now_ns) else ()
        if not message.seq < len(items):
            self._acknowledge(common.MAV_MISSION_INVALID_SEQUENCE, source(message), peer)
            return
        whole = message.get_msgId() == common.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        item = self._home() if message.seq < HOME else items[message.seq]
        current = message.seq == self._seq(now_ns)
        answer = message_of(item, message.seq, source(message), current=current, whole=whole)
        self._context.links.reply(answer, peer)

    def _home(self) -> MissionItem:
        """Return where the robot started, in degrees where that can be said."""
        home, origin = self._context.robot.home, self._context.origin
        command, params = common.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0)
        if origin is not None:
            place = origin.from_world(home.x_m, home.y_m)
            return MissionItem(command, common.MAV_FRAME_GLOBAL, params, *place, origin.altitude_m)
        north, east = ned_from_enu(home.x_m, home.y_m)
        return MissionItem(command, common.MAV_FRAME_LOCAL_NED, params, north, east, 0.0)

    # How far it is.

    @property
    def _around(self) -> Surroundings:
        robot = self._context.robot
        return Surroundings(robot.home, self._context.origin, robot.plans)

    def _is_loaded(self, navigation: NavigationState) -> bool:
        """Return whether the robot's mission is the one that came over MAVLink."""
        return bool(self._plan.crc) and navigation.mission_crc == self._plan.crc

    def _is_there(self, now_ns: int) -> bool:
        navigation = self._context.fresh_navigation(now_ns)
        return navigation is not None and self._is_loaded(navigation)

    def _seq(self, now_ns: int) -> int:
        """Return the number of the present item; home, 0, without a mission of MAVLink."""
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is None or not self._is_loaded(navigation):
            return 0
        return self._plan.seq_of(navigation.item)

    def _set_current(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take MISSION_SET_CURRENT, which is answered by MISSION_CURRENT."""
        why = self._objection(peer, source(message), now_ns)
        result = common.MAV_MISSION_DENIED
        if not why and not self._jump(message.seq, now_ns):
            why = f"there is no item {message.seq} to go on with"
            result = common.MAV_MISSION_INVALID_SEQUENCE
        if why:
            self._context.say(now_ns, f"Mission: {why}")
            self._acknowledge(result, source(message), peer)

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
        if to is None or not 0 <= seq < len(self._plan.items):
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
                reached = common.MAVLink_mission_item_reached_message(seq)
                self._context.links.broadcast(reached)

    def _current(self, now_ns: int) -> list[Message]:
        """Return MISSION_CURRENT."""
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is None:
            return []
        state = _state_of(navigation)
        mode = 1 if navigation.mode is Mode.AUTO else 2
        total = max(len(self._plan.items) - HOME, 0) if self._is_there(now_ns) else 0
        return [common.MAVLink_mission_current_message(self._seq(now_ns), total, state, mode)]


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
