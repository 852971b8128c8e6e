"""The fence: a ground station's side of the protocol, and where a simulated robot then drives."""

import math
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as m

from robotctl.app.processes.navigation import take_bounds
from robotctl.app.processes.plan_files import PlanFiles, load_bounds
from robotctl.control.limiter import LimitsConfig
from robotctl.core.fence_keeper import DAMAGED, FenceKeeper
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.fence_items import BadItem, check_fence_item, fence_of, read_fence
from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import Mode, PositionTarget, SafetyState
from robotctl.messages.fence import EnableFence, FenceState, SetFence
from robotctl.model.fence import Fence, FenceCircle, FencePolygon
from robotctl.model.fence_clearance import body_clearance
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from tests.mavlink.conftest import FakeLinks, control_state
from tests.mavlink.driven_robot import DrivenRobot

FENCE = m.MAV_MISSION_TYPE_FENCE
INSIDE = m.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
OUTSIDE = m.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
CIRCLE, CIRCLE_OUT = m.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, m.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
RETURN = m.MAV_CMD_NAV_FENCE_RETURN_POINT
NED, GLOBAL = m.MAV_FRAME_LOCAL_NED, m.MAV_FRAME_GLOBAL
ACCEPTED = m.MAV_MISSION_ACCEPTED
MANUAL, GUIDED = 0, 15


def polygon(command, *corners):
    """Return the items of a polygon; corners are x, y of `world` [m]."""
    return [(command, (len(corners), 0.0, 0.0, 0.0), x, y) for x, y in corners]


def circle(command, x, y, radius):
    return [(command, (radius, 0.0, 0.0, 0.0), x, y)]


PLAN = [
    *polygon(INSIDE, (0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0)),
    *polygon(OUTSIDE, (1.0, 1.0), (2.0, 1.0), (2.0, 2.0)),
    *circle(CIRCLE_OUT, 3.0, 5.0, 0.75),
]
SHAPES = Fence(
    (
        FencePolygon(((0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0)), True),
        FencePolygon(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)), False),
    ),
    (FenceCircle(3.0, 5.0, 0.75, False),),
)


def message(seq, item):
    command, params, x, y = item
    place = round(y * 1e4), round(x * 1e4)  # north, east
    return m.MAVLink_mission_item_int_message(
        1, 1, seq, NED, command, 0, 1, *params, *place, 0.0, FENCE
    )


def upload(plan, receive, step, take):
    """Upload as a ground station does; return what is answered."""
    receive(m.MAVLink_mission_count_message(1, 1, len(plan), FENCE))
    for _ in range(200):
        step()
        for sent in take():
            if sent.get_type() == "MISSION_ACK" and sent.mission_type == FENCE:
                return sent.type
            if sent.get_type() == "MISSION_REQUEST_INT":
                assert sent.mission_type == FENCE
                receive(message(sent.seq, plan[sent.seq]))
    raise AssertionError("no answer")


class Navigation:
    """The navigation process, as far as its fence goes."""

    def __init__(self, bench):
        self.bench = bench
        self.fence = FenceState()
        self.taken = []

    def step(self):
        others = []
        bench = self.bench
        for request in bench.step(bench.navigation(fence=self.fence), bench.control()):
            if isinstance(request, SetFence):
                self.taken.append(request)
                self.fence = FenceState(request.crc, not request.fence.is_empty)
            else:
                others.append(request)
        return others

    def upload(self, plan):
        return upload(
            plan, self.bench.receive, self.step, lambda: [each for each, _ in self.bench.take()]
        )

    def download(self):
        bench = self.bench
        bench.receive(m.MAVLink_mission_request_list_message(1, 1, FENCE))
        self.step()
        (count,) = bench.messages("MISSION_COUNT")
        assert count.mission_type == FENCE
        found = []
        for seq in range(count.count):
            bench.receive(m.MAVLink_mission_request_int_message(1, 1, seq, FENCE))
            self.step()
            found += bench.messages("MISSION_ITEM_INT")
        return [(x.command, x.frame, x.param1, x.x, x.y, x.mission_type) for x in found]


@pytest.fixture
def navigation(bench):
    found = Navigation(bench)
    found.step()
    bench.take()
    return found


@given(
    st.floats(-1.0, 11.0), st.floats(-1.0, 9.0),
    st.sampled_from([SHAPES, Fence(SHAPES.polygons[:1]), Fence((), SHAPES.circles)]),
)  # fmt: skip
def test_a_point_is_allowed_where_a_body_without_size_is_clear_of_the_fence(x, y, fence):
    point = Footprint.rectangle(-1e-9, 1e-9, 1e-9)
    (clear_m,) = body_clearance(fence, point, np.array([[x, y, 0.0]]))
    if abs(clear_m) > 1e-6:
        assert fence.allows(x, y) == (clear_m > 0.0)


PLACES_BEYOND = [(9.5, 3.0), (1.9, 1.5), (3.1, 5.1)]


@pytest.mark.parametrize(("x", "y"), [*PLACES_BEYOND, (5.0, 5.0), (1.2, 1.8)])
@pytest.mark.parametrize("enabled", [True, False])
def test_places_beyond_the_fence_are_refused_in_guided_with_words(navigation, x, y, enabled):
    assert navigation.upload(PLAN) == ACCEPTED
    bench = navigation.bench
    fence = msgspec.structs.replace(navigation.fence, enabled=enabled)
    guided = {"mode": Mode.GUIDED, "fence": fence}
    armed, north_east = {"state": SafetyState.ARMED}, (y, x)
    wanted = not enabled or (x, y) not in PLACES_BEYOND

    def sent(request):
        bench.step(bench.navigation(**guided), bench.control(**armed))
        bench.take()
        bench.receive(request)
        requests = bench.step(bench.navigation(**guided), bench.control(**armed))
        found = [(e.x_m, e.y_m) for e in requests if isinstance(e, PositionTarget)]
        assert found == ([pytest.approx((x, y))] if wanted else [])
        bench.step(bench.navigation(**guided), bench.control(**armed))
        answers = [each for each, _ in bench.take()]
        words = "".join(each.text for each in answers if each.get_type() == "STATUSTEXT")
        assert ("beyond the fence" in words) == (not wanted)
        return [each for each in answers if each.get_type().endswith("_ACK")]

    place = [round(1e4 * each) for each in north_east]
    go = m.MAVLink_command_int_message(
        1, 1, NED, m.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0, math.nan, *place, 0
    )
    (ack,) = sent(go)
    assert ack.result == (m.MAV_RESULT_ACCEPTED if wanted else m.MAV_RESULT_DENIED)
    setpoint = m.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, NED, 0xFF8, *north_east, *[0.0] * 9
    )
    assert sent(setpoint) == []
    single = m.MAVLink_mission_item_int_message(
        1, 1, 0, NED, m.MAV_CMD_NAV_WAYPOINT, 2, 1, 0, 0, 0, 0, *place, 0.0
    )
    (ack,) = sent(single)
    assert ack.type == (ACCEPTED if wanted else m.MAV_MISSION_DENIED)


def test_a_fence_is_taken_means_what_it_says_and_comes_back_as_it_was(navigation):
    assert navigation.upload(PLAN) == ACCEPTED
    assert navigation.taken[-1].fence == SHAPES
    sent = [message(seq, item) for seq, item in enumerate(PLAN)]
    assert navigation.download() == [(x.command, x.frame, x.param1, x.x, x.y, FENCE) for x in sent]
    navigation.bench.receive(m.MAVLink_mission_request_list_message(1, 1))
    navigation.step()
    (count,) = navigation.bench.messages("MISSION_COUNT")
    assert (count.count, count.mission_type) == (0, m.MAV_MISSION_TYPE_MISSION)


@pytest.mark.parametrize(
    ("plan", "result", "word"),
    [
        ([(16, (0.0,) * 4, 1.0, 1.0)], m.MAV_MISSION_UNSUPPORTED, "command 16"),
        (polygon(INSIDE, (0, 0), (1, 0)), m.MAV_MISSION_INVALID_PARAM1, "2 corners"),
        (
            [*polygon(INSIDE, (0, 0), (1, 0), (1, 1))[:2], *circle(CIRCLE, 0, 0, 1)],
            m.MAV_MISSION_INVALID_PARAM1,
            "3 corners has 2",
        ),
        (circle(CIRCLE, 0, 0, -1.0), m.MAV_MISSION_INVALID_PARAM1, "radius -1"),
        ([(CIRCLE, (1.0, 2.0, 0.0, 0.0), 0, 0)], m.MAV_MISSION_INVALID_PARAM2, "group 2"),
        ([(RETURN, (0.0,) * 4, 0, 0)], m.MAV_MISSION_INVALID, "nothing"),
    ],
)
def test_what_is_no_fence_leaves_the_old_one_and_is_said(navigation, plan, result, word):
    assert navigation.upload(PLAN) == ACCEPTED
    before = navigation.taken[-1]
    bench, answers = navigation.bench, []

    def take():
        sent = [each for each, _ in bench.take()]
        answers.extend(x.text for x in sent if x.get_type() == "STATUSTEXT")
        return sent

    assert upload(plan, bench.receive, navigation.step, take) == result
    navigation.step()
    take()
    assert any(word in text for text in answers), answers
    assert navigation.taken[-1] == before
    assert len(navigation.download()) == len(PLAN)


def test_clearing_the_fence_or_all_leaves_none(navigation):
    for kind in (FENCE, m.MAV_MISSION_TYPE_ALL):
        assert navigation.upload(PLAN) == ACCEPTED
        navigation.bench.take()
        navigation.bench.receive(m.MAVLink_mission_clear_all_message(1, 1, kind))
        for _ in range(3):
            navigation.step()
        assert [x.type for x in navigation.bench.messages("MISSION_ACK")] == [ACCEPTED]
        assert navigation.taken[-1].fence.is_empty
        assert navigation.download() == []


def test_the_fence_is_switched_and_its_state_is_told(navigation):
    bench, command = navigation.bench, m.MAV_CMD_DO_FENCE_ENABLE

    def ask(value):
        bench.command(command, value)
        requests = navigation.step()
        return requests, [x.result for x in bench.messages("COMMAND_ACK")]

    assert ask(1) == ([], [m.MAV_RESULT_DENIED])
    assert navigation.upload(PLAN) == ACCEPTED
    ((request,), (result,)) = ask(0)
    assert (request.enabled, result) == (False, m.MAV_RESULT_ACCEPTED)
    assert isinstance(request, EnableFence)
    assert ask(2) == ([], [m.MAV_RESULT_DENIED])
    bit = m.MAV_SYS_STATUS_GEOFENCE

    def told(**changes):
        navigation.fence = msgspec.structs.replace(navigation.fence, **changes)
        bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_SYS_STATUS)
        bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_FENCE_STATUS)
        bench.take()
        navigation.step()
        sent = {each.get_type(): each for each, _ in bench.take()}
        status, fence = sent["SYS_STATUS"], sent["FENCE_STATUS"]
        bits = tuple(
            bool(getattr(status, f"onboard_control_sensors_{name}") & bit)
            for name in ("present", "enabled", "health")
        )
        return bits, (fence.breach_status, fence.breach_count, fence.breach_type)

    assert told(enabled=True) == ((True, True, True), (0, 0, m.FENCE_BREACH_NONE))
    assert told(breached=True, breaches=3) == (
        (True, True, False),
        (1, 3, m.FENCE_BREACH_BOUNDARY),
    )
    assert told(enabled=False, breached=False)[0] == (True, False, True)


def test_a_fence_outlives_a_power_cut_for_navigation_and_telemetry(make_bench, tmp_path):
    store = PlanFiles(str(tmp_path), "fence")

    def started():
        bench = make_bench()
        bench.telemetry = Telemetry(bench.config, bench.robot, bench.links, stores={"fence": store})
        return Navigation(bench)

    navigation = started()
    navigation.step()
    assert navigation.upload(PLAN) == ACCEPTED
    (kept,) = load_bounds(str(tmp_path), "fence")
    assert kept.fence == SHAPES
    again = started()
    again.fence = FenceState(kept.crc, True)  # navigation has read the file, too
    again.step()
    assert again.taken == []
    assert len(again.download()) == len(PLAN)
    late = started()  # navigation could not
    late.step()
    assert late.taken[-1].fence == SHAPES


def test_a_robot_whose_fence_is_damaged_stands_until_there_is_one_or_none(tmp_path):
    PlanFiles(str(tmp_path), "fence").save(b'{"fence": ')
    body = Footprint.rectangle(-0.2, 0.2, 0.18)
    keeper = FenceKeeper(LimitsConfig(), body, 50_000_000, 200_000_000, steered=False)
    adapter = SimpleNamespace(fence=keeper, bound_by=lambda _: None)
    (notice,) = take_bounds(adapter, SimpleNamespace(state=str(tmp_path)))
    assert "the fence cannot be read" in notice
    control, wanted = control_state(0), Twist(0.3, 0.0)
    assert keeper.keep(control, SE2(), wanted, 0) == Twist(0.0, 0.0)
    assert keeper.message == DAMAGED
    keeper.take(SetFence(0, Fence(), 0))
    assert keeper.keep(control, SE2(), wanted, 0) == wanted


@settings(max_examples=30)
@given(st.binary(max_size=60))
def test_a_damaged_file_is_no_fence(content):
    assert read_fence(content).content == b""


numbers = st.floats(width=32)
items = st.builds(
    MissionItem,
    st.sampled_from([INSIDE, OUTSIDE, CIRCLE, CIRCLE_OUT, RETURN, 16]),
    st.sampled_from([NED, GLOBAL, m.MAV_FRAME_BODY_NED]),
    st.tuples(st.sampled_from([3.0, 4.0, math.nan]) | numbers, *[st.just(0.0) | numbers] * 3),
    numbers,
    numbers,
    numbers,
)


@settings(max_examples=50)
@given(st.lists(items, max_size=4), st.sampled_from([None, Origin(48.0, 11.0)]))
def test_whatever_floats_items_have_they_are_refused_or_come_back(found, origin):
    try:
        for seq, each in enumerate(found):
            check_fence_item(each, seq, origin)
        plan, _ = fence_of(found, origin)
    except BadItem:
        return
    assert read_fence(plan.content) == plan
    assert msgspec.json.encode(plan.fence)


class Fenced:
    """A simulated robot with a fence."""

    def __init__(self, plan, mode, **robot):
        self.links = FakeLinks()
        self.robot = DrivenRobot(self.links, **robot)
        self.robot.arm(mode)
        config = self.robot.config
        self.body = config.footprint
        self.fence = fence_of([MissionItem(c, NED, p, y, x, 0.0) for c, p, x, y in plan], None)[
            0
        ].fence
        self.nearest_m = math.inf
        assert upload(plan, self.robot.send, lambda: self.robot.run(0.05), self.take) == ACCEPTED

    def take(self):
        sent, self.links.sent = self.links.sent, []
        return [each for each, _ in sent]

    def clearance(self):
        return float(body_clearance(self.fence, self.body, np.array([self.robot.pose()]))[0])

    def run(self, seconds, message=None):
        for _ in range(round(seconds * 10)):
            self.robot.run(0.1, message)
            self.nearest_m = min(self.nearest_m, self.clearance())

    def notices(self):
        return " ".join(self.robot.navigation.take_notices())


def sticks(z=0, y=0):
    return m.MAVLink_manual_control_message(1, 0, y, z, 0, 0)


@pytest.mark.parametrize("name", ["diff_drive", "ackermann"])
def test_by_hand_at_full_speed_the_body_stays_within_and_can_be_driven_away(name):
    fenced = Fenced(circle(CIRCLE, 6.0, 5.0, 1.6), MANUAL, robot=name)
    fenced.run(5.0, sticks(z=1000, y=100))
    assert 0.0 < fenced.nearest_m < 0.15
    said = fenced.notices()
    assert "slows down" in said
    assert "stops before it" in said
    before = fenced.clearance()
    fenced.run(2.0, sticks(z=-500))
    assert fenced.clearance() > before + 0.2
    fenced.run(5.0, sticks(z=-1000, y=-700))
    assert fenced.nearest_m > 0.0
    assert not fenced.robot.state.fence.breached


def test_a_velocity_of_guided_ends_at_the_fence_and_a_disabled_one_is_none():
    wall = polygon(INSIDE, (4.0, 3.5), (7.2, 3.5), (7.2, 6.5), (4.0, 6.5))
    fenced = Fenced(wall, GUIDED)
    ahead = m.MAVLink_set_position_target_local_ned_message(
        0, 1, 0, m.MAV_FRAME_BODY_NED, 0xFC7, *(0.0,) * 3, 0.5, *(0.0,) * 7
    )
    fenced.run(4.0, ahead)
    assert 0.0 < fenced.nearest_m < 0.1
    assert fenced.robot.pose()[0] < 7.2
    fenced.robot.command(m.MAV_CMD_DO_FENCE_ENABLE, 0)
    fenced.run(2.0, ahead)
    assert fenced.clearance() < 0.0
    fenced.robot.command(m.MAV_CMD_DO_FENCE_ENABLE, 1)
    fenced.run(0.5)
    assert fenced.robot.state.fence.breached
    back = m.MAVLink_set_position_target_local_ned_message(
        0, 1, 0, m.MAV_FRAME_BODY_NED, 0xFC7, *(0.0,) * 3, -0.5, *(0.0,) * 7
    )
    fenced.run(3.5, back)
    assert fenced.clearance() > 0.1
    assert not fenced.robot.state.fence.breached


def test_a_keeper_brakes_by_the_limits_in_force():
    """With a tenth of the deceleration the robot is held back much earlier."""

    def held(a_max_m_s2):
        limits = LimitsConfig()
        body = Footprint.rectangle(-0.2, 0.2, 0.18)
        keeper = FenceKeeper(limits, body, 50_000_000, 200_000_000, steered=False)
        keeper.retune(replace(limits, a_max_m_s2=a_max_m_s2), body)
        keeper.take(SetFence(0, Fence(circles=(FenceCircle(0.0, 0.0, 2.0, True),)), 1))
        state = control_state(10**9, v_m_s=0.5, v_ref_m_s=0.5)
        return keeper.keep(state, SE2(0.6, 0.0, 0.0), Twist(0.5, 0.0), 10**9)

    assert held(1.0) == Twist(0.5, 0.0)
    assert held(0.1).v_m_s < 0.5


def test_a_keeper_holds_back_the_body_in_its_present_state():
    small, large = (Footprint.rectangle(-x_m, x_m, 0.2) for x_m in (0.2, 0.8))
    fence = SetFence(0, Fence(circles=(FenceCircle(0.0, 0.0, 2.0, True),)), 1)

    def held(body, state):
        keeper = FenceKeeper(LimitsConfig(), body, 50_000_000, 200_000_000, steered=False)
        keeper.take(fence)
        keeper.retune(LimitsConfig(), state)
        control = control_state(10**9, v_m_s=0.5, v_ref_m_s=0.5)
        return keeper.keep(control, SE2(1.0, 0.0, 0.0), Twist(0.5, 0.0), 10**9)

    assert held(small, small) == held(large, small) == Twist(0.5, 0.0)
    assert held(small, large) == held(large, large)
    assert held(small, large).v_m_s < 0.5
