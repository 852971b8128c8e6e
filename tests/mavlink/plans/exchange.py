"""Two stations, the services for plans, and navigation, held against the model."""

import math
import tomllib
import zlib
from collections import deque

from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.services.plans.fences import Fences
from robotctl.mavlink.services.plans.missions import Missions
from robotctl.mavlink.services.plans.rally import RallyPoints
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import Mode
from robotctl.messages.fence import FenceState, SetFence, SetRally
from robotctl.messages.mavlink_port import Peer, Received
from robotctl.messages.mission import LoadMission
from tests.mavlink.conftest import FakeLinks, navigation_state
from tests.mavlink.plans.protocol_model import HOME, Model

MISSION, FENCE, RALLY = 0, 1, 2
STATIONS = {"a": (255, Peer(0, 0)), "b": (254, Peer(0, 1))}
STEP_MS, COARSE_MS = 20, 200
DELAY_MS = 2 * STEP_MS
"""Navigation has taken a plan after this."""
REFUSED_MS, SOONEST_MS = 1200, 100
CODEC = m.MAVLink(None, 1, 1)


class QuickLinks(FakeLinks):
    """Links that only keep what is sent, packed as the wire would need it."""

    clients = tuple(peer for _, peer in STATIONS.values())

    def reply(self, message, peer):
        message.pack(CODEC)
        self.sent.append((message, peer))

    broadcast = lambda *_: None  # noqa: E731


class Exchange:
    """A robot of a personality, for one kind of plans; `drives`: AUTO drives a mission.

    A plan is known by the east coordinates of its items, in decimetres.
    """

    def __init__(self, kind=MISSION, personality="ardupilot", *, drives=False):
        self.kind, self.drives = kind, drives
        self.homes = int(kind == MISSION and personality == "ardupilot")
        self.model = Model(self.homes)
        self.links = QuickLinks()
        self.telemetry = Telemetry(
            MavlinkConfig(personality=personality), TelemetryRobot("tester", "1.2.3"),
            self.links, services=(Missions, Fences, RallyPoints),
        )  # fmt: skip
        self.now_ms = 1_000_000
        self._state = {}
        self._changes = deque()
        self.plan = ()
        """What navigation has."""
        self._labels = iter(range(1, 1_000_000))
        self._last = dict.fromkeys(STATIONS)
        self._crc = self._adopted = 0
        """Of the plan of navigation, and of the last that was told as taken."""
        self._asked = None
        """The plan that navigation was asked to take: its CRC, what it is, and when [ms]."""
        self._requested_ms = 0
        self.heard = lambda _: None
        """Is told all that the robot says, as the model puts it."""
        self.visited = set()
        """Each state of the model with each message that came in it."""

    # What stations say, to the robot and to the model.

    def say(self, station, word, *values):
        """Let a station send a message, by the name of a method of the model or a kind of item."""
        self._publish(self.now_ms + STEP_MS)
        self.visited.add((self.model.state, (station, (word, *values))))
        if word in {"right", "wrong", "again", "bad", "old"}:
            self._item(station, word)
            return
        getattr(self.model, word)(station, *values)
        make = {
            "count": m.MAVLink_mission_count_message,
            "partial": m.MAVLink_mission_write_partial_list_message,
            "clear": m.MAVLink_mission_clear_all_message,
            "ack": m.MAVLink_mission_ack_message,
            "list": m.MAVLink_mission_request_list_message,
            "request": m.MAVLink_mission_request_int_message,
        }[word]
        self._send(make(1, 1, *values, self.kind), station)

    def _item(self, station, word):
        """Send the item that is wanted (right), the one behind it, or the last again."""
        wanted = self.model.wanted(station) or 0
        if word == "again" and self._last[station] is not None:
            seq, label, good, old = self._last[station]
        else:
            seq, label = wanted + (word == "wrong"), next(self._labels)
            good, old = word != "bad", word == "old"
        self._last[station] = seq, label, good, old
        is_home = seq < self.homes
        self.model.item(station, seq, HOME if is_home else label, good)
        command, first = {
            MISSION: (m.MAV_CMD_NAV_WAYPOINT, 0.0),
            FENCE: (m.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, 1.0),
            RALLY: (m.MAV_CMD_NAV_RALLY_POINT, 0.0),
        }[self.kind]
        make = m.MAVLink_mission_item_message if old else m.MAVLink_mission_item_int_message
        place = (0.0, label / 10) if old else (0, label * 1000)
        message = make(
            1, 1, seq, m.MAV_FRAME_LOCAL_NED, command, 0, 1, first, 0.0, 0.0, math.nan,
            *place, 0.0 if good else math.nan, self.kind,
        )  # fmt: skip
        self._send(message, station)

    def _send(self, message, station):
        system, peer = STATIONS[station]
        message._header.srcSystem, message._header.srcComponent = system, 190
        self.links.incoming.append(Received(message, peer))

    # What time brings.

    def step(self, step_ms=STEP_MS):
        """Let robot and model go on, and compare what they say."""
        self.now_ms += step_ms
        self._publish(self.now_ms)
        now_ns = self.now_ms * 1_000_000
        mode = Mode.AUTO if self.drives else Mode.HOLD
        navigation = navigation_state(now_ns, mode=mode, message="busy", **self._state)
        requests = self.telemetry.step(now_ns, [navigation])
        self._decide()
        for request in requests:
            self._take(request)
        self.model.go_on(self.now_ms)
        self._compare()

    def _publish(self, now_ms):
        """Let the state of navigation have what it has taken by a time."""
        while self._changes and self._changes[0][0] <= now_ms:
            _, change, self._crc, self.plan = self._changes.popleft()
            self._state |= change
        self.model.is_there = self._crc == self._adopted

    def _decide(self):
        """Tell the model what navigation has decided."""
        if self._asked is None:
            return
        crc, plan, asked_ms = self._asked
        taken = crc == self._crc
        if taken or self.now_ms - asked_ms > REFUSED_MS:
            assert self.model.undecided[0][0] == plan, "navigation was asked for another plan"
            self._asked = None
            self._adopted = crc if taken else self._adopted
            self.model.is_there = self._crc == self._adopted
            self.model.decide(taken)

    def _take(self, request):
        """Be navigation: take a plan a little later, unless AUTO drives a mission."""
        if isinstance(request, LoadMission):
            content, crc = request.content, zlib.crc32(request.content)
            places = tomllib.loads(content.decode())["item"] if content else ()
            plan = tuple(round(10 * each["x_m"]) for each in places)
            change = {"items": len(plan), "mission_crc": crc}
        elif isinstance(request, SetFence):
            plan, crc = tuple(round(10 * each.x_m) for each in request.fence.circles), request.crc
            change = {"fence": FenceState(crc=crc)}
        else:
            assert isinstance(request, SetRally)
            plan, crc = tuple(round(10 * x_m) for x_m, _ in request.places), request.crc
            change = {"rally_crc": crc}
        assert self._asked is None, "navigation was asked for two plans at once"
        self._asked = crc, plan, self.now_ms
        if not (self.drives and isinstance(request, LoadMission)):
            self._changes.append((self.now_ms + DELAY_MS, change, crc, plan))

    def _compare(self):
        """Compare what robot and model have said since the last step."""
        said = []
        for message, peer in self.links.sent:
            (station,) = (name for name, (_, at) in STATIONS.items() if at == peer)
            assert message.target_system == STATIONS[station][0]
            assert message.mission_type == self.kind
            kind = message.get_type()
            if kind == "MISSION_ACK":
                said.append((station, "ACK", message.type))
            elif kind == "MISSION_COUNT":
                said.append((station, "COUNT", message.count))
            elif kind == "MISSION_ITEM_INT":
                is_home = message.seq < self.homes
                label = HOME if is_home else round(message.y / 1000)
                said.append((station, "ITEM", message.seq, label))
            else:
                assert kind in {"MISSION_REQUEST", "MISSION_REQUEST_INT"}
                said.append((station, "REQUEST", message.seq))
        self.links.sent.clear()
        self.heard(said)
        expected, self.model.replies = self.model.replies, []
        upload = self.model.upload
        if upload is not None:
            request = (upload.station, "REQUEST", len(upload.items))
            if request in said and request not in expected:
                said.remove(request)
                assert self.now_ms - self._requested_ms >= SOONEST_MS, "asked again too soon"
                self._requested_ms = self.now_ms
            elif request in said:
                self._requested_ms = self.now_ms
        assert sorted(said) == sorted(expected), (self.model.state, said, expected)
        for station in STATIONS:  # each of them hears it in this order
            assert [x for x in said if x[0] == station] == [x for x in expected if x[0] == station]
        assert self.plan == self.model.plan or self._asked is not None

    def wait(self, gap_ms):
        """Let time pass, at first in short steps, in which navigation answers."""
        fine, coarse = min(gap_ms // STEP_MS, 4), gap_ms // COARSE_MS
        for step_ms in [STEP_MS] * fine + [COARSE_MS] * coarse:
            self.step(step_ms)

    def settle(self):
        """Let all that is under way end, without a word of the stations."""
        self.wait(10_000)
        assert self.model.state == "idle"
