"""Missions: a ground station's side of the protocol, over links that lose, repeat and reorder."""

import math
import random
import tomllib
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import Mode, PositionTarget, SafetyState, SetMode
from robotctl.messages.mission import JumpToItem, LoadMission
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.mission.mission_file import parse_mission
from tests.mavlink.conftest import Bench

ACCEPTED, DENIED = m.MAV_MISSION_ACCEPTED, m.MAV_MISSION_DENIED
WAYPOINT, JUMP = m.MAV_CMD_NAV_WAYPOINT, m.MAV_CMD_DO_JUMP
CIRCLE = m.MAV_CMD_NAV_LOITER_TURNS
NED = m.MAV_FRAME_LOCAL_NED
NAN = math.nan


def item(seq, command=WAYPOINT, params=(0, 0, 0, NAN), x=0.0, y=0.0, frame=NED, **kw):
    """Return MISSION_ITEM_INT; x and y in metres, or degrees in a global frame."""
    scale = 1e4 if frame in (NED, m.MAV_FRAME_LOCAL_ENU) else 1e7
    params = [float(each) for each in (*params, 0, 0, 0, 0)[:4]]
    place = round(x * scale), round(y * scale)
    return m.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, kw.get("current", 0), 1, *params, *place, 0.0
    )


HOME = item(0)
PLAN = [
    HOME,
    item(1, x=3.0, y=1.5),
    item(2, m.MAV_CMD_DO_CHANGE_SPEED, (1, 0.3, -1)),
    item(3, params=(5, 0, 0, 90), x=-2.0, y=4.0),
    item(4, JUMP, (1, 2)),
    item(5, m.MAV_CMD_NAV_RETURN_TO_LAUNCH),
]


class Navigation:
    """The navigation process, as far as its missions go."""

    def __init__(self, bench, refuses=""):
        self.bench, self.refuses = bench, refuses
        self.state = {}
        self.offered = []

    def step(self, advance_s=0.02, **changes):
        """Step telemetry with a state; take what it asks for; return the other requests."""
        state = self.bench.navigation(**(self.state | changes))
        others = []
        for request in self.bench.step(state, self.bench.control(), advance_s=advance_s):
            if not isinstance(request, LoadMission):
                others.append(request)
                continue
            self.offered.append(request)
            if self.refuses:
                self.state["message"] = self.refuses
            elif request.content:
                mission = parse_mission(request.content.decode(), "uploaded")
                items, crc = len(mission.item), zlib.crc32(request.content)
                self.state |= {"items": items, "mission_crc": crc, "mission": mission.name}
            else:
                self.state |= {"items": 0, "mission_crc": 0, "mission": ""}
        return others

    @property
    def mission(self):
        return tomllib.loads(self.offered[-1].content.decode())


@pytest.fixture
def navigation(bench):
    found = Navigation(bench)
    found.step()
    bench.take()
    return found


def upload(navigation, plan, **source):
    """Upload as a ground station does; return the acknowledgement."""
    bench = navigation.bench
    bench.receive(m.MAVLink_mission_count_message(1, 1, len(plan)), **source)
    for _ in range(3 * len(plan) + 10):
        navigation.step()
        for message, _ in bench.take():
            if message.get_type() == "MISSION_ACK":
                return message.type
            if message.get_type() == "MISSION_REQUEST_INT":
                bench.receive(plan[message.seq], **source)
    raise AssertionError("no answer")


def download(navigation):
    """Return the items that the robot has, as MISSION_ITEM_INT."""
    bench = navigation.bench
    bench.receive(m.MAVLink_mission_request_list_message(1, 1))
    navigation.step()
    (count,) = bench.messages("MISSION_COUNT")
    found = []
    for seq in range(count.count):
        bench.receive(m.MAVLink_mission_request_int_message(1, 1, seq))
        navigation.step()
        found += bench.messages("MISSION_ITEM_INT")
    return found


def numbers(message):
    return (
        message.seq, message.command, message.frame, round(message.param1, 5),
        round(message.param2, 5), message.x, message.y,
    )  # fmt: skip


def test_a_mission_is_taken_means_what_it_says_and_comes_back_as_it_was(navigation):
    assert upload(navigation, PLAN) == ACCEPTED
    items = navigation.mission["item"]
    assert [each["kind"] for each in items] == ["goto", "goto", "wait", "jump", "goto"]
    first, second, wait, jump, home = items
    assert (first["x_m"], first["y_m"]) == (1.5, 3.0)  # x is east, y is north
    assert "speed_m_s" not in first
    assert (second["x_m"], second["y_m"]) == (4.0, -2.0)
    assert second["speed_m_s"] == pytest.approx(0.3)
    assert second["heading_deg"] == pytest.approx(0.0, abs=1e-9)  # yaw 90 is east
    assert wait["duration_s"] == 5.0
    assert (jump["to"], jump["times"]) == (1, 2)
    assert (home["x_m"], home["y_m"]) == (0.0, 0.0)
    back = download(navigation)
    assert [numbers(each) for each in back[1:]] == [numbers(each) for each in PLAN[1:]]
    assert back[0].command == WAYPOINT


def test_some_items_are_replaced_and_the_whole_is_checked(navigation):
    assert upload(navigation, PLAN) == ACCEPTED
    before, bench = navigation.mission, navigation.bench
    changed = [item(3, x=7.0, y=8.0), item(4, JUMP, (1, 5))]

    def replace(first, last, items):
        bench.take()
        bench.receive(m.MAVLink_mission_write_partial_list_message(1, 1, first, last))
        for _ in range(20):
            navigation.step()
            for message in [each for each, _ in bench.take()]:
                if message.get_type() == "MISSION_ACK":
                    return message.type
                if message.get_type() == "MISSION_REQUEST_INT":
                    bench.receive(items[message.seq])
        raise AssertionError("no answer")

    for first, last in ((4, 3), (3, 6), (-1, 2)):
        assert replace(first, last, {}) == m.MAV_MISSION_INVALID_SEQUENCE
    bad = {4: item(4, JUMP, (99, 5))}
    assert replace(4, 4, bad) == m.MAV_MISSION_INVALID_PARAM1
    assert navigation.mission == before
    assert replace(3, 4, {each.seq: each for each in changed}) == ACCEPTED
    expected = [*PLAN[1:3], *changed, PLAN[5]]
    assert [numbers(each) for each in download(navigation)[1:]] == [numbers(e) for e in expected]


def test_what_went_wrong_leaves_the_old_mission_and_is_said(navigation):
    assert upload(navigation, PLAN) == ACCEPTED
    before = navigation.mission
    for bad, result, word in (
        (item(2, m.MAV_CMD_NAV_TAKEOFF), m.MAV_MISSION_UNSUPPORTED, "22"),
        (item(2, frame=m.MAV_FRAME_GLOBAL), m.MAV_MISSION_UNSUPPORTED_FRAME, "origin"),
        (item(2, frame=m.MAV_FRAME_BODY_NED), m.MAV_MISSION_UNSUPPORTED_FRAME, "frame 8"),
        (item(2, m.MAV_CMD_NAV_DELAY, (-3,)), m.MAV_MISSION_INVALID_PARAM1, "-3 s"),
        (item(2, m.MAV_CMD_DO_CHANGE_SPEED, (1, 0)), m.MAV_MISSION_INVALID_PARAM2, "0 m/s"),
        (item(2, JUMP, (9, 1)), m.MAV_MISSION_INVALID_PARAM1, "jumps to 9"),
        (item(2, JUMP, (1, -2)), m.MAV_MISSION_INVALID_PARAM2, "-2 times"),
        (item(2, CIRCLE, (0, 0, 1)), m.MAV_MISSION_INVALID_PARAM1, "0 turns"),
        (item(2, CIRCLE, (2, 0, 0)), m.MAV_MISSION_INVALID_PARAM3, "radius 0 m"),
        (item(2, CIRCLE, (2, 0, NAN)), m.MAV_MISSION_INVALID_PARAM3, "radius nan m"),
        (item(2, params=(math.inf,)), m.MAV_MISSION_INVALID_PARAM1, "inf found in param1"),
    ):
        navigation.bench.run(2.0)
        navigation.bench.take()
        bench = navigation.bench
        bench.receive(m.MAVLink_mission_count_message(1, 1, 3))
        answers = []
        for _ in range(10):
            navigation.step()
            for message, _ in bench.take():
                if message.get_type() == "MISSION_REQUEST_INT":
                    bench.receive([HOME, item(1, x=1.0), bad][message.seq])
                elif message.get_type() in {"MISSION_ACK", "STATUSTEXT"}:
                    answers.append(message)
        (ack,) = [each for each in answers if each.get_type() == "MISSION_ACK"]
        assert ack.type == result, bad
        said = "".join(each.text for each in answers if each.get_type() == "STATUSTEXT")
        assert "item 2" in said, (bad, said)
        assert word in said, (bad, said)
    assert navigation.mission == before
    assert len(download(navigation)) == len(PLAN)


def test_a_mission_that_navigation_refuses_is_denied_with_its_reason(bench):
    navigation = Navigation(bench, refuses="a mission is under way; pause or abort it first")
    navigation.step()
    bench.receive(m.MAVLink_mission_count_message(1, 1, 2))
    seen = []
    for _ in range(120):
        navigation.step()
        for message, _ in bench.take():
            if message.get_type() == "MISSION_REQUEST_INT":
                bench.receive([HOME, item(1, x=1.0)][message.seq])
            seen.append(message)
    (ack,) = [each for each in seen if each.get_type() == "MISSION_ACK"]
    assert ack.type == DENIED
    texts = [each.text for each in seen if each.get_type() == "STATUSTEXT"]
    assert any("under way" in text for text in texts)
    assert download(navigation) == []


def test_an_upload_that_ends_early_is_given_up_and_another_station_may_begin(navigation):
    bench = navigation.bench
    bench.receive(m.MAVLink_mission_count_message(1, 1, 3))
    navigation.step()
    bench.receive(m.MAVLink_mission_count_message(1, 1, 3), system=254)
    navigation.step()
    sent = bench.take()
    assert [x.type for x, _ in sent if x.get_type() == "MISSION_ACK"] == [DENIED]
    requests = 0
    for _ in range(600):
        navigation.step()
        sent = bench.take()
        requests += sum(x.get_type().startswith("MISSION_REQUEST") for x, _ in sent)
        acks = [x.type for x, _ in sent if x.get_type() == "MISSION_ACK"]
        if acks:
            break
    assert acks == [m.MAV_MISSION_OPERATION_CANCELLED]
    assert requests == 7  # and one at the start
    assert upload(navigation, PLAN, system=254) == ACCEPTED


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_a_fifth_lost_and_some_repeated_and_late_both_ways_still_gives_the_same_mission(seed):
    rng = random.Random(seed)
    navigation = Navigation(Bench())
    bench = navigation.bench
    plan = [HOME, *(item(k, x=0.1 * k, y=-0.2 * k) for k in range(1, 12))]
    count = m.MAVLink_mission_count_message(1, 1, len(plan))
    late, told, last_s = [count], None, 0.0
    for _ in range(3000):
        navigation.step(advance_s=0.05)
        last_s += 0.05
        for message, _ in bench.take():
            if rng.random() < 0.2:
                continue
            if message.get_type() == "MISSION_ACK":
                told = message.type
            elif message.get_type() == "MISSION_REQUEST_INT":
                late += [plan[message.seq]] * (2 if rng.random() < 0.2 else 1)
                last_s = 0.0
        if told is not None:
            break
        if last_s > 1.6:  # as ground stations do
            late.append(count if not navigation.offered else plan[-1])
            last_s = 0.0
        rng.shuffle(late)
        while late and rng.random() < 0.7:
            message = late.pop()
            if rng.random() >= 0.2:
                bench.receive(message)
    assert told == ACCEPTED
    assert [numbers(each) for each in download(navigation)[1:]] == [numbers(x) for x in plan[1:]]


def test_clearing_and_an_empty_list_leave_no_mission(navigation):
    for clear in (
        m.MAVLink_mission_clear_all_message(1, 1),
        m.MAVLink_mission_clear_all_message(1, 1, m.MAV_MISSION_TYPE_ALL),
        m.MAVLink_mission_count_message(1, 1, 0),
    ):
        assert upload(navigation, PLAN) == ACCEPTED
        navigation.bench.receive(clear)
        navigation.step()
        navigation.step()
        assert [x.type for x in navigation.bench.messages("MISSION_ACK")] == [ACCEPTED]
        assert navigation.offered[-1].content == b""
        assert download(navigation) == []


def test_an_unknown_kind_is_refused_once(navigation):
    kind = 77
    assert upload(navigation, PLAN) == ACCEPTED
    for message in (
        m.MAVLink_mission_count_message(1, 1, 2, kind),
        m.MAVLink_mission_request_list_message(1, 1, kind),
        m.MAVLink_mission_clear_all_message(1, 1, kind),
    ):
        navigation.bench.receive(message)
        navigation.step()
        (ack,) = navigation.bench.messages("MISSION_ACK")
        assert (ack.type, ack.mission_type) == (m.MAV_MISSION_UNSUPPORTED, kind)
    assert len(download(navigation)) == len(PLAN)


def test_old_messages_are_answered_in_kind(navigation):
    bench = navigation.bench
    old = [
        m.MAVLink_mission_item_message(1, 1, k, NED, WAYPOINT, 0, 1, 0, 0, 0, 0, 1.5 * k, 2.0, 0)
        for k in range(2)
    ]
    assert upload(navigation, old) == ACCEPTED
    assert navigation.mission["item"][0]["y_m"] == 1.5
    bench.receive(m.MAVLink_mission_request_message(1, 1, 1))
    navigation.step()
    (answer,) = bench.messages("MISSION_ITEM")
    assert (answer.x, answer.y) == (1.5, 2.0)
    bench.receive(m.MAVLink_mission_request_int_message(1, 1, 2))
    navigation.step()
    assert [x.type for x in bench.messages("MISSION_ACK")] == [m.MAV_MISSION_INVALID_SEQUENCE]


def test_progress_is_told_in_the_numbers_of_the_station(navigation):
    assert upload(navigation, PLAN) == ACCEPTED
    bench = navigation.bench

    def current(**changes):
        bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_MISSION_CURRENT)
        navigation.step(**changes)
        sent = bench.take()
        reached = [x.seq for x, _ in sent if x.get_type() == "MISSION_ITEM_REACHED"]
        (found, *_) = [x for x, _ in sent if x.get_type() == "MISSION_CURRENT"]
        return found.seq, found.total, found.mission_state, reached

    current(item=0)
    assert current(item=0) == (1, 5, m.MISSION_STATE_NOT_STARTED, [])
    auto = {"mode": Mode.AUTO}
    assert current(item=1, **auto) == (3, 5, m.MISSION_STATE_ACTIVE, [1])
    assert current(item=2, **auto)[3] == []  # it waits: item 3 goes on
    assert current(item=3, **auto)[3] == [3]
    assert current(item=0, **auto)[3] == []  # it jumped
    done = {"item": 5, "mission_completed": True}
    assert current(**done, **auto)[2:] == (m.MISSION_STATE_COMPLETE, [1, 3, 4, 5])


def test_an_item_can_be_chosen_and_the_mission_started(navigation):
    assert upload(navigation, PLAN) == ACCEPTED
    bench = navigation.bench
    bench.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, 3)
    assert [x.item for x in navigation.step() if isinstance(x, JumpToItem)] == [2]
    bench.receive(m.MAVLink_mission_set_current_message(1, 1, 5))
    assert [x.item for x in navigation.step() if isinstance(x, JumpToItem)] == [5]
    bench.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, 6)
    assert navigation.step() == []
    results = [x.result for x in bench.messages("COMMAND_ACK")]
    assert results == [m.MAV_RESULT_ACCEPTED, m.MAV_RESULT_DENIED]
    bench.command(m.MAV_CMD_MISSION_START)
    (request,) = navigation.step()
    assert isinstance(request, SetMode)
    assert request.mode is Mode.AUTO
    navigation.step(mode=Mode.AUTO)
    assert [x.result for x in bench.messages("COMMAND_ACK")] == [m.MAV_RESULT_ACCEPTED]


@pytest.mark.parametrize("end", ["mission_completed", "mission_failed"])
def test_a_late_copy_of_a_choice_does_not_set_off_a_robot_at_its_end(navigation, end):
    assert upload(navigation, PLAN) == ACCEPTED
    bench = navigation.bench
    ended = {"mode": Mode.AUTO, "item": 4, end: True}
    for _ in range(2):
        navigation.step(**ended)
    bench.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, 1)
    assert navigation.step(**ended) == []
    bench.receive(m.MAVLink_mission_set_current_message(1, 1, 1))
    assert navigation.step(**ended) == []
    sent = bench.take()
    assert [x.result for x, _ in sent if x.get_type() == "COMMAND_ACK"] == [
        m.MAV_RESULT_TEMPORARILY_REJECTED
    ]
    assert [x.type for x, _ in sent if x.get_type() == "MISSION_ACK"] == [DENIED]
    navigation.step(**ended | {"mode": Mode.HOLD})
    bench.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, 1)
    (request,) = navigation.step(**ended | {"mode": Mode.HOLD})
    assert isinstance(request, JumpToItem)


def test_with_an_origin_degrees_are_places(navigation):
    bench = navigation.bench
    bench.receive(m.MAVLink_set_gps_global_origin_message(1, 480_000_000, 110_000_000, 500_000))
    navigation.step()
    (told,) = bench.messages("GPS_GLOBAL_ORIGIN")
    assert (told.latitude, told.longitude, told.altitude) == (480_000_000, 110_000_000, 500_000)
    latitude, longitude = Origin(48.0, 11.0).from_world(12.0, -7.0)
    there = item(1, x=latitude, y=longitude, frame=m.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    assert upload(navigation, [HOME, there]) == ACCEPTED
    (goal,) = navigation.mission["item"]
    assert (goal["x_m"], goal["y_m"]) == pytest.approx((12.0, -7.0), abs=0.02)
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    navigation.step()
    (position,) = bench.messages("GLOBAL_POSITION_INT")
    found = Origin(48.0, 11.0).to_world(position.lat / 1e7, position.lon / 1e7)
    assert found == pytest.approx((1.0, 2.0), abs=0.02)  # where the bench's robot stands
    assert position.hdg == 9000  # it looks east


class Store:
    def __init__(self, content=b""):
        self.content = content

    def load(self):
        return self.content

    def save(self, content):
        self.offered = content
        return "/state/mavlink-mission.toml"

    def keep(self, content):
        self.content = content


def test_a_mission_outlives_a_power_cut_and_a_new_telemetry(make_bench):
    store = Store()

    def started(**state):
        bench = make_bench()
        robot = TelemetryRobot("tester", "1.2.3", home=SE2(0.5, 0.25, 0.0))
        bench.telemetry = Telemetry(bench.config, robot, bench.links, stores={"mission": store})
        navigation = Navigation(bench)
        navigation.state |= state
        navigation.step()
        return navigation

    first = started()
    assert upload(first, PLAN) == ACCEPTED
    assert first.offered[-1].file == "/state/mavlink-mission.toml"
    for state in ({}, first.state):  # all of the robot is new; only telemetry is
        again = started(**state)
        again.step()
        assert len(again.offered) == (0 if state else 1)
        assert [numbers(x) for x in download(again)[1:]] == [numbers(x) for x in PLAN[1:]]
    bench = first.bench
    bench.receive(m.MAVLink_mission_count_message(1, 1, 3))  # an upload that a power cut ends
    first.step()
    assert store.content == first.offered[-1].content
    other = started(items=4, mission_crc=77)  # one of the operator's on this computer
    assert other.offered == []
    assert download(other) == []
    store.content = b"# MAVLink: {damaged\n"
    assert download(started()) == []


@given(
    st.lists(
        st.tuples(
            st.sampled_from([16, 19, 20, 93, 112, 177, 178, 195, 22, 9999]),
            st.integers(0, 12),
            *[st.floats(width=32)] * 6,
        ),
        min_size=1,
        max_size=4,
    )
)
def test_whatever_floats_an_item_has_it_is_refused_or_comes_back(found):
    navigation = Navigation(Bench())
    plan = [HOME]
    for seq, (command, frame, *numbers_) in enumerate(found, 1):
        plan.append(m.MAVLink_mission_item_message(1, 1, seq, frame, command, 0, 1, *numbers_, 0.0))
    if upload(navigation, plan) == ACCEPTED:
        assert [each.command for each in download(navigation)[1:]] == [x.command for x in plan[1:]]


def on_globe(seq, x, y):
    place = Origin(48.0, 11.0).from_world(x, y)
    return item(seq, x=place[0], y=place[1], frame=m.MAV_FRAME_GLOBAL)


def origin(latitude):
    return m.MAVLink_set_gps_global_origin_message(1, round(1e7 * latitude), 110_000_000, 0)


def test_places_on_the_globe_keep_their_origin_also_over_a_power_cut(make_bench):
    store = Store()

    def started(**config):
        bench = make_bench(**config)
        robot = TelemetryRobot("tester", "1.2.3")
        bench.telemetry = Telemetry(bench.config, robot, bench.links, stores={"mission": store})
        found = Navigation(bench)
        found.step()
        found.step()
        return found

    first = started()
    first.bench.receive(origin(48.0))
    first.step()
    assert upload(first, [HOME, on_globe(1, 5.0, 2.0)]) == ACCEPTED
    again = started()
    (goal,) = again.mission["item"]
    assert (goal["x_m"], goal["y_m"]) == pytest.approx((5.0, 2.0), abs=0.02)
    for robot in (first, again):
        bench = robot.bench
        bench.take()
        bench.receive(origin(48.001))  # the places would be 111 m to the south
        robot.step()
        assert bench.messages("GPS_GLOBAL_ORIGIN") == []
        bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
        robot.step()
        assert [x.latitude for x in bench.messages("GPS_GLOBAL_ORIGIN")] == [480_000_000]
    assert started(origin=Origin(48.001, 11.0)).offered == []  # the robot's file says another


def test_another_station_can_neither_upload_nor_clear_during_an_upload(navigation):
    assert upload(navigation, PLAN) == ACCEPTED
    bench = navigation.bench
    bench.receive(m.MAVLink_mission_count_message(1, 1, 3))
    navigation.step()
    for message in (
        m.MAVLink_mission_clear_all_message(1, 1), m.MAVLink_mission_count_message(1, 1, 0),
    ):  # fmt: skip
        bench.take()
        bench.receive(message, system=254)
        navigation.step()
        assert [x.type for x in bench.messages("MISSION_ACK")] == [DENIED]
    assert len(download(navigation)) == len(PLAN)


def test_home_may_be_read_without_a_mission(navigation):
    """As ArduPilot has it; dronekit asks for item 0 whatever the count is."""
    bench = navigation.bench
    assert download(navigation) == []
    bench.receive(m.MAVLink_mission_request_message(1, 1, 0))
    navigation.step()
    (home,) = bench.messages("MISSION_ITEM")
    assert (home.seq, home.command) == (0, WAYPOINT)
    bench.receive(m.MAVLink_mission_request_message(1, 1, 1))
    navigation.step()
    assert [e.type for e in bench.messages("MISSION_ACK")] == [m.MAV_MISSION_INVALID_SEQUENCE]


@pytest.mark.parametrize(
    ("changes", "state", "mode", "result"),
    [
        ({}, SafetyState.ARMED, Mode.GUIDED, ACCEPTED),
        ({}, SafetyState.ARMED, Mode.HOLD, DENIED),
        ({}, SafetyState.STANDBY, Mode.GUIDED, DENIED),
        ({"current": 3}, SafetyState.ARMED, Mode.GUIDED, m.MAV_MISSION_UNSUPPORTED),
        ({"command": JUMP}, SafetyState.ARMED, Mode.GUIDED, m.MAV_MISSION_UNSUPPORTED),
        (
            {"frame": m.MAV_FRAME_GLOBAL}, SafetyState.ARMED, Mode.GUIDED,
            m.MAV_MISSION_UNSUPPORTED_FRAME,
        ),
    ],
)  # fmt: skip
def test_a_single_item_is_driven_to_in_guided(navigation, changes, state, mode, result):
    bench = navigation.bench
    bench.step(bench.control(state=state), bench.navigation(mode=mode))
    bench.take()
    bench.receive(item(0, **({"current": 2, "x": 3.0, "y": 1.5} | changes)))
    requests = bench.step(bench.control(state=state), bench.navigation(mode=mode))
    assert [e.type for e in bench.messages("MISSION_ACK")] == [result]
    wanted = [(1.5, 3.0)] if result == ACCEPTED else []
    assert [(e.x_m, e.y_m) for e in requests if isinstance(e, PositionTarget)] == wanted
    assert download(navigation) == []


def test_a_station_that_knows_only_the_older_messages_uploads_too(navigation):
    """dronekit: silent until MISSION_REQUEST comes, and then answers by MISSION_ITEM."""
    bench = navigation.bench
    bench.receive(m.MAVLink_mission_count_message(1, 1, 3))
    asked, began_ns = [], bench.now_ns
    for _ in range(150):
        navigation.step()
        for message, _ in bench.take():
            if message.get_type() == "MISSION_ACK":
                assert message.type == ACCEPTED
                assert asked == [0, 1, 2]
                assert bench.now_ns - began_ns < 1.5e9  # only the first waits
                return
            if message.get_type() == "MISSION_REQUEST":
                asked.append(message.seq)
                place = float(message.seq), 2.0, 0.0
                bench.receive(
                    m.MAVLink_mission_item_message(
                        1, 1, message.seq, NED, WAYPOINT, 0, 1, 0.0, 0.0, 0.0, 0.0, *place
                    )
                )
    raise AssertionError("no answer")
