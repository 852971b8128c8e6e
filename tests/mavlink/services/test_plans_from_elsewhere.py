"""Missions and fences that the robot has from a file or its page, as ground stations read them."""

import zlib

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.fence_items import fence_items, fence_of
from robotctl.mavlink.missions.of_file import plan_of_file
from robotctl.mavlink.missions.translate import MissionContext, translate
from robotctl.messages.fence import FenceFile, FenceState
from robotctl.messages.mission import LoadMission
from robotctl.messages.plans import BoundsView, MissionView
from robotctl.model.fence import Fence, FenceCircle, FencePolygon
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.mission.mission_file import parse_mission
from robotctl.web.plan_uploads import MissionUpload, offered
from tests.mavlink.services.plans.test_missions import download, item

ORIGIN = Origin(48.0, 11.0, 500.0)
TEXT = """
name = "from the page"
start = { x_m = 0.0, y_m = 0.0 }

[[item]]
kind = "goto"
name = "door"
x_m = 3.0
y_m = 1.5

[[item]]
kind = "wait"
duration_s = 5.0

[[item]]
kind = "goto"
x_m = -2.0
y_m = 4.0
heading_deg = 90.0
speed_m_s = 0.3

[[item]]
kind = "repeat"
first = "door"
times = 3
"""


@pytest.fixture
def telemetry(bench):
    """Step telemetry with navigation's state and views; answer to `download`."""

    class Elsewhere:
        def __init__(self):
            self.bench, self.state, self.views = bench, {}, []

        def step(self, **changes):
            self.bench.step(
                self.bench.navigation(**(self.state | changes)), self.bench.control(), *self.views
            )

    return Elsewhere()


def have(telemetry, text):
    """Let navigation have a mission as a page has sent it."""
    content = offered(MissionUpload(client=1, id=1, at_ms=1.0, text=text), 1).content
    crc = zlib.crc32(content)
    items = len(parse_mission(text, "x").item)
    telemetry.state = {"items": items, "mission_crc": crc}
    telemetry.views = [MissionView(1, "", crc, content)]
    telemetry.step()
    telemetry.bench.take()


def test_a_mission_of_the_page_is_the_one_that_stations_download(telemetry):
    have(telemetry, TEXT)
    home, door, wait, speed, table, jump = download(telemetry)
    assert home.command == m.MAV_CMD_NAV_WAYPOINT
    assert (door.x, door.y) == (15000, 30000)  # north and east, 1e-4 m
    assert (wait.command, wait.param1) == (m.MAV_CMD_NAV_DELAY, 5.0)
    assert (speed.command, round(speed.param2, 3)) == (m.MAV_CMD_DO_CHANGE_SPEED, 0.3)
    assert table.param4 == 360.0  # north: 0 would be any
    assert (jump.command, jump.param1, jump.param2) == (m.MAV_CMD_DO_JUMP, 1.0, 2.0)


def test_its_present_item_is_told(telemetry):
    have(telemetry, TEXT)
    for index, seq in ((0, 1), (1, 2), (2, 4), (3, 5)):
        telemetry.state["item"] = index
        telemetry.step()
        telemetry.bench.receive(m.MAVLink_mission_request_list_message(1, 1))
        telemetry.bench.take()
        telemetry.bench.receive(m.MAVLink_mission_request_int_message(1, 1, seq))
        telemetry.step()
        (message,) = telemetry.bench.messages("MISSION_ITEM_INT")
        assert message.current == 1


def test_a_mission_for_which_mavlink_has_no_words_is_none_to_stations(telemetry):
    have(telemetry, TEXT.replace('kind = "wait"\nduration_s = 5.0', 'kind = "explore"'))
    telemetry.bench.receive(m.MAVLink_mission_request_list_message(1, 1))
    telemetry.step()
    (count,) = telemetry.bench.messages("MISSION_COUNT")
    assert count.count == 0


def test_a_mission_of_a_station_comes_in_the_place_of_the_pages(telemetry):
    have(telemetry, TEXT)
    bench = telemetry.bench
    plan = [item(0), item(1, x=7.0, y=0.0)]
    bench.receive(m.MAVLink_mission_count_message(1, 1, len(plan)))
    for _ in range(20):
        requests = bench.step(bench.navigation(**telemetry.state), bench.control())
        for request in requests:
            if isinstance(request, LoadMission):
                telemetry.state |= {"items": 1, "mission_crc": zlib.crc32(request.content)}
        for message, _ in bench.take("MISSION_REQUEST_INT"):
            bench.receive(plan[message.seq])
    assert [each.x for each in download(telemetry)] == [0, 70000]


NUMBER = st.floats(-1e4, 1e4).map(lambda each: round(each, 3))
ITEMS = st.lists(
    st.fixed_dictionaries(
        {"kind": st.just("goto"), "x_m": NUMBER, "y_m": NUMBER},
        optional={"heading_deg": st.floats(-180, 180), "speed_m_s": st.sampled_from([0.2, 0.5])},
    )
    | st.fixed_dictionaries(
        {
            "kind": st.just("circle"),
            "x_m": NUMBER,
            "y_m": NUMBER,
            "radius_m": st.sampled_from([0.5, 2.0]),
        },
        optional={
            "turns": st.sampled_from([0.5, 3.0]),
            "side": st.sampled_from(["left", "right"]),
            "speed_m_s": st.sampled_from([0.2, 0.5]),
        },
    )
    | st.fixed_dictionaries({"kind": st.just("wait"), "duration_s": st.floats(0.1, 1e4)}),
    min_size=1,
    max_size=6,
)


@settings(deadline=None)
@given(ITEMS, st.sampled_from([None, ORIGIN]))
def test_items_that_a_station_sends_back_mean_the_same(items, origin):
    lines = ['name = "n"', "start = { x_m = 0.0, y_m = 0.0 }"]
    for each in items:
        lines += ["[[item]]", *(f"{key} = {value!r}" for key, value in each.items())]
    text = "\n".join(lines).replace("'", '"')
    plan = plan_of_file(text.encode(), origin)
    meaning = translate(plan.items, MissionContext(SE2(), origin, plans=True))
    assert len(meaning.items) == len(items)
    for found, wanted in zip(meaning.items, items, strict=True):
        assert found["kind"] == wanted["kind"]
        for key in ("x_m", "y_m", "speed_m_s", "duration_s"):
            assert found.get(key) == pytest.approx(wanted.get(key), abs=1e-3)
        if wanted["kind"] == "circle":
            assert (found["radius_m"], found["turns"]) == (
                wanted["radius_m"],
                wanted.get("turns", 1.0),
            )
            assert found["side"] == wanted.get("side", "left")
        if wanted.get("heading_deg") is not None:
            turned = (found["heading_deg"] - wanted["heading_deg"] + 180) % 360 - 180
            assert turned == pytest.approx(0.0, abs=1e-6)


FENCE = Fence(
    (
        FencePolygon(((0.0, 0.0), (9.0, 0.0), (9.0, 7.0)), True),
        FencePolygon(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)), False),
    ),
    (FenceCircle(3.0, 5.0, 0.75, False),),
)


@pytest.mark.parametrize("origin", [None, ORIGIN])
def test_the_items_of_a_drawn_fence_mean_that_fence(origin):
    plan, notes = fence_of(fence_items(FENCE, origin), origin)
    assert notes == []
    for found, wanted in zip(plan.fence.polygons, FENCE.polygons, strict=True):
        assert found.keeps_in == wanted.keeps_in
        assert [*found.corners[2]] == pytest.approx([*wanted.corners[2]], abs=1e-6)
    assert plan.fence.circles[0].radius_m == 0.75


def test_a_drawn_fence_is_read_by_stations_and_one_cleared_elsewhere_is_none(telemetry):
    crc = zlib.crc32(msgspec.json.encode(FenceFile(FENCE)))
    fenced = BoundsView(1, FENCE, crc, True, (), 0, (), 0, (0.0, 0.0, 0.0))
    telemetry.state, telemetry.views = {"fence": FenceState(crc, enabled=True)}, [fenced]
    telemetry.step()
    telemetry.bench.take()

    def count():
        telemetry.bench.receive(
            m.MAVLink_mission_request_list_message(1, 1, m.MAV_MISSION_TYPE_FENCE)
        )
        telemetry.step()
        return telemetry.bench.messages("MISSION_COUNT")[-1].count

    assert count() == 7
    free = msgspec.structs.replace(fenced, fence=Fence(), fence_crc=0)
    telemetry.state, telemetry.views = {"fence": FenceState()}, [free]
    telemetry.step()
    assert count() == 0
