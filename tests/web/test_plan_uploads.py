"""Missions, fences and zones that foreign clients send, and orders to the mission."""

from __future__ import annotations

import contextlib
import json
import time
import tomllib
import zlib

import httpx
import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robotctl.messages.control import Mode, NavigationState
from robotctl.messages.fence import FenceFile, FenceState, SetFence
from robotctl.messages.mission import AbortMission, GoAhead, JumpToItem, LoadMission
from robotctl.messages.plans import BoundsView, MissionView, SetZones, ZonesFile
from robotctl.model.fence import Fence
from robotctl.web.access import Role
from robotctl.web.desk import Desk
from robotctl.web.plan_uploads import (
    MAX_PLAN_BYTES,
    BadPlan,
    FenceUpload,
    MissionUpload,
    ZonesUpload,
    mission_tree,
    offered,
    read_upload,
)
from robotctl.web.robot_view import Now
from robotctl.web.wire import CameraPicture
from tests.web.clients import TOKENS, cookie_of, of, take_over, wait
from tests.web.conftest import Served

TEXT = 'name = "n"\nstart = { x_m = 0, y_m = 0 }\n[[item]]\nkind = "wait"\nduration_s = 1\n'
SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
ZONE = {"name": "stairs", "corners": SQUARE, "speed_m_s": 0.0}
FENCE = {"type": "FenceUpload", "polygons": [[SQUARE, True]], "circles": [[2, 2, 1, False]]}
ZONES = {"type": "ZonesUpload", "zones": [ZONE]}
MISSION = {"type": "MissionUpload", "text": TEXT}


def state(message="", mode=Mode.HOLD, **fields) -> NavigationState:
    now_ns = time.monotonic_ns()
    return NavigationState(now_ns, mode, "", 0, 0, "", False, False, message, **fields)


class Page:
    """A page with its clock and number, as foreign clients would be one."""

    def __init__(self, served: Served, cookie: str = "") -> None:
        self.served, self.cookie = served, cookie
        self.ws = served.client(cookie=cookie)
        self.number = self.ws.read("Hello")["client"]
        self.ws.synchronise()

    def post(self, plan, path="/plans", age_ms=0.0, **headers):
        """Send a plan; on a computer that stood still it came late, and is sent again."""
        for _ in range(5):
            stamped = {**plan, "client": self.number, "id": 7, "at_ms": self.ws.at_ms() - age_ms}
            answer = self.send(json.dumps(stamped).encode(), path, **headers)
            if age_ms or "late: ask again" not in answer.text:
                break
        return answer

    def send(self, body, path="/plans", **headers):
        headers = {"Origin": self.served.url, "Cookie": self.cookie, **headers}
        url = f"{self.served.url}{path}"
        return httpx.post(url, content=body, headers=headers, trust_env=False, timeout=20)


@pytest.fixture
def page(served):
    page = Page(served)
    yield page
    page.ws.ws.close()


class Store:
    """Remembers what is kept."""

    def __init__(self) -> None:
        self.saved, self.kept = [], []

    def save(self, content):
        self.saved.append(content)
        return f"/state/{zlib.crc32(content):08x}"

    def keep(self, content):
        self.kept.append(content)


@pytest.mark.parametrize(
    ("plan", "kind", "content"),
    [
        (MISSION, "mission", lambda each: each.content == TEXT.encode()),
        (FENCE, "fence", lambda each: each.fence.circles == ((2, 2, 1, False),)),
        (ZONES, "zones", lambda each: each.zones[0].name == "stairs"),
    ],
)
def test_a_plan_reaches_navigation_and_is_kept_once_that_has_it(served, page, plan, kind, content):
    store = Store()
    served.page._robot.stores = {kind: store}
    answer = page.post(plan)
    assert answer.status_code == 200, answer.text
    request = wait(lambda: of(served.robot.navigation, (LoadMission, SetFence, SetZones)))[-1]
    assert content(request)
    crc = answer.json()["crc"]
    assert crc == zlib.crc32(store.saved[-1])  # by which navigation names it
    if kind == "mission":
        assert request.file == f"/state/{crc:08x}"
    assert store.kept == []
    if kind == "zones":
        bounds = BoundsView(1, Fence(), 0, False, request.zones, crc, (), 0, (0, 0, 0))
        served.robot.publish(bounds)
    else:
        served.robot.publish(
            state(mission_crc=crc if kind == "mission" else 0, fence=FenceState(crc))
        )
    wait(lambda: store.kept == store.saved)


def test_a_plan_that_navigation_does_not_take_is_refused_in_its_words(served, page):
    store = Store()
    served.page._robot.stores = {"mission": store}
    served.robot.publish(state("refused: a mission is under way; pause or abort it first"))
    assert page.post(MISSION).status_code == 200
    refused = page.ws.read("Refused")
    assert refused["id"] == 7
    assert "a mission is under way" in refused["reason"]
    assert store.kept == []


def test_what_is_kept_nowhere_is_said(served, page):
    assert page.post(ZONES).status_code == 200
    wait(lambda: served.robot.said == ["the zones cannot be saved, a restart will lose it"])


def test_of_two_plans_of_a_kind_the_first_is_told_that_another_came():
    desk = Desk(has_localiser=False, arm_timeout_ns=10**9)
    now = Now(10**12, 10**12)
    for client in (1, 2):
        desk.join(client, f"connection {client}", may_drive=True)
        stamp = {"client": client, "id": 7, "at_ms": 1.0}
        desk.offer(client, 7, offered(ZonesUpload(**stamp, zones=()), 5), now)
    (answer,) = desk.take().answers
    assert answer.connection == "connection 1"
    assert answer.message.reason == "another one came behind it"


@pytest.mark.parametrize("plan", [MISSION, FENCE, ZONES])
def test_a_plan_of_long_ago_or_of_nobody_is_not_handed_on(served, page, plan):
    assert "late: ask again" in page.post(plan, age_ms=1500.0).text
    assert "ahead of the robot's clock" in page.post(plan, age_ms=-60_000.0).text
    page.number = 99
    assert "not connected" in page.post(plan).text
    assert served.robot.navigation == []


def test_nobody_changes_plans_under_another_driver(served, page):
    with served.client() as driver:
        driver.synchronise()
        take_over(driver)
        answer = page.post(ZONES)
    assert answer.status_code == 409
    assert "drives: take over first" in answer.text


def test_a_foreign_page_or_one_without_the_role_posts_nothing(static):
    with Served(static, TOKENS) as served:
        look = Page(served, cookie_of(served, Role.LOOK))
        drive = Page(served, cookie_of(served, Role.DRIVE))
        with look.ws, drive.ws:
            assert look.post(MISSION).status_code == 403
            assert drive.post(MISSION, Cookie="").status_code == 403
            foreign = drive.post(MISSION, Origin="http://evil.example")
            assert foreign.status_code == 403
            drive.number = look.number  # the cookie of one, the connection of another
            assert "look only" in drive.post(MISSION).text
            assert served.robot.navigation == []
            assert look.send(TEXT.encode(), "/toml").json()["name"] == "n"


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ({"type": "MissionUpload", "text": TEXT.replace("1\n", "-1\n")}, "mission.toml:5: item[0]"),
        ({"type": "MissionUpload", "text": "a = ="}, "line 1"),
        (
            {"type": "MissionUpload", "text": TEXT + '[[zone]]\nname = "z"\n'},
            "mission.toml:6: zone",
        ),
        ({**FENCE, "polygons": [[SQUARE[:2], True]]}, "polygon 1: 2 corners found, 3 to 200"),
        ({**FENCE, "circles": [[0, 0, 0, True]]}, "circle 1: radius 0 m"),
        ({**FENCE, "circles": [[1e300, 0, 1, True]]}, "circle 1: 1e+300 m away"),
        ({**ZONES, "zones": [{**ZONE, "name": ""}]}, "0 letters, 1 to 60"),
        ({**ZONES, "zones": [{**ZONE, "speed_m_s": -1}]}, "zone stairs: -1 m/s found"),
        ({**ZONES, "zones": [{**ZONE, "corners": [[0, 0]] * 201}]}, "201 corners"),
        ({**ZONES, "zones": [ZONE] * 201}, "length <= 200"),
        ({**ZONES, "zones": [{**ZONE, "colour": 1}]}, "colour"),
        ({"type": "SetFence"}, "Invalid value"),
    ],
)
def test_what_is_wrong_with_a_plan_is_said_in_words(served, page, plan, words):
    answer = page.post(plan)
    assert answer.status_code == 422
    assert words in answer.text
    assert served.robot.navigation == []


def test_a_body_that_is_too_long_is_refused_and_a_long_mission_is_not(served, page):
    assert page.send(b"x" * (MAX_PLAN_BYTES + 1)).status_code == 413
    wait_item = '[[item]]\nkind = "wait"\nduration_s = 1\nname = "one of a thousand"\n'
    long = {"type": "MissionUpload", "text": TEXT + 999 * wait_item}
    assert page.post(long).status_code == 200
    assert "1001 items found" in page.post({**long, "text": TEXT + 1000 * wait_item}).text


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)
KEYS = ("type", "client", "id", "at_ms", "text", "polygons", "circles", "zones")
LINES = st.lists(
    st.sampled_from(
        [
            *TEXT.splitlines(),
            "[[item]]",
            'kind = "goto"',
            'kind = "repeat"',
            "x_m = nan",
            "y_m = -inf",
            "times = 99999999999999999999",
            "x_m = 1e400",
            "[[zone]]",
            "corners = [[0,0],[1,1],[2,0]]",
            "speed_m_s = 0",
            "item = 1",
            "start = 1979-05-27",
            "a.b.c = 1",
            '"\\u0000" = 1',
            "recovery = { wait_s = -1 }",
        ]
    )
    | st.text(max_size=20)
)


@given(st.binary(max_size=200) | JSON.map(lambda each: json.dumps(each).encode()))
def test_garbage_is_no_plan(body):
    with contextlib.suppress(BadPlan):
        read_upload(body)
    with contextlib.suppress(BadPlan):
        mission_tree(body)


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from([MISSION, FENCE, ZONES]).flatmap(
        lambda plan: st.dictionaries(st.sampled_from(KEYS), JSON, max_size=2).map(
            lambda changed: {**plan, "client": 1, "id": 1, "at_ms": 1.0, **changed}
        )
    )
)
def test_a_plan_with_parts_of_another_kind_is_taken_whole_or_refused(plan):
    try:
        found = offered(read_upload(json.dumps(plan).encode()), 5)
    except BadPlan as error:
        _is_said(error)
        return
    _is_what_navigation_takes(found)


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(LINES)
def test_a_mission_of_any_lines_is_refused_in_words_or_one_that_navigation_takes(lines):
    text = "\n".join(lines)
    try:
        found = offered(MissionUpload(client=1, id=1, at_ms=1.0, text=text), 5)
    except BadPlan as error:
        _is_said(error)
        return
    _is_what_navigation_takes(found)


def _is_said(error):
    assert str(error).strip()


def _is_what_navigation_takes(found):
    """Check a plan as its readers do, who are not the page's server."""
    request = msgspec.msgpack.decode(
        msgspec.msgpack.encode(found.request), type=LoadMission | SetFence | SetZones
    )
    assert request == found.request
    match request:
        case LoadMission(content=content) if content:
            assert tomllib.loads(content.decode())["item"]
        case SetFence(fence=fence) if found.content:
            assert msgspec.json.decode(found.content, type=FenceFile).fence == fence
        case SetZones(zones=zones) if found.content:
            assert msgspec.json.decode(found.content, type=ZonesFile).zones == zones


def test_none_of_each_is_a_plan_too():
    stamp = {"client": 1, "id": 1, "at_ms": 1.0}
    for upload in (
        MissionUpload(**stamp, text=""),
        FenceUpload(**stamp, polygons=(), circles=()),
        ZonesUpload(**stamp, zones=()),
    ):
        found = offered(upload, 5)
        assert (found.content, found.crc) == (b"", 0)


# Orders to the mission


@pytest.mark.parametrize(
    ("order", "kind"),
    [("GoOn", GoAhead), ("JumpTo", JumpToItem), ("Abort", AbortMission)],
)
def test_an_order_to_the_mission_is_handed_on_and_its_refusal_comes_back(served, order, kind):
    fields = {"item": 3} if order == "JumpTo" else {}
    with served.client() as page:
        page.synchronise()
        served.robot.publish(state("refused: no mission is loaded", mission_commands=4))
        page.read("NavigationState")
        page.send(order, id=1, at_ms=page.at_ms(), **fields)
        assert page.read("Refused")["reason"] == "refused: no mission is loaded"
        page.send(order, id=2, at_ms=page.at_ms(), **fields)
        wait(lambda: len(of(served.robot.navigation, kind)) == 2)
        served.robot.publish(state(mission_commands=5))
        with pytest.raises(AssertionError, match="no Refused"):
            page.read("Refused", 2.0)
        page.send(order, id=3, at_ms=page.at_ms() - 2000.0, **fields)
        if order == "Abort":  # it lets the robot stand
            wait(lambda: len(of(served.robot.navigation, kind)) == 3)
        else:
            assert "late" in page.read("Refused")["reason"]


def test_a_new_client_gets_mission_and_bounds_once_and_others_only_what_changes(served):
    bounds = BoundsView(1, Fence(), 0, False, (), 0, (), 0, (0.0, 0.0, 0.0))
    with served.client() as first:
        first.read("Hello")
        for stamp in range(1, 4):
            served.robot.publish(MissionView(stamp, "", 5, b"x"))
            served.robot.publish(msgspec.structs.replace(bounds, stamp_ns=stamp))
            first.read("ControlState")
        served.robot.publish(MissionView(9, "", 6, b"y"))
        first.read("MissionView", where=lambda each: each["crc"] == 6)
        assert sum(each["type"] == "MissionView" for each in first.seen) == 2
        assert sum(each["type"] == "BoundsView" for each in first.seen) == 1
        with served.client() as second:
            assert second.read("MissionView")["crc"] == 6
            second.read("BoundsView")


# The camera


class Camera:
    """Has a picture whenever it is asked, which it counts."""

    def __init__(self) -> None:
        self.asked_s, self.is_open = [], False

    def picture(self, _view):
        self.is_open = True
        self.asked_s.append(time.monotonic())
        return CameraPicture(1, 8, 6, b"jpeg")

    def close(self):
        self.is_open = False


def test_pictures_go_to_those_who_watch_five_times_a_second_and_end_with_them(served):
    served.page._robot.camera = camera = Camera()
    with served.client() as other, served.client() as page:
        other.read("Hello")
        page.send("WatchCamera", watch=True)
        begin_s = time.monotonic()
        for _ in range(6):
            assert page.read("CameraPicture")["jpeg"] == b"jpeg"
        assert time.monotonic() - begin_s >= 4.9 * 0.2
        page.send("WatchCamera", watch=False)
        wait(lambda: not camera.is_open)
        count = len(camera.asked_s)
        page.send("WatchCamera", watch=True)
        page.read("CameraPicture")
        assert len(camera.asked_s) > count
        other.read("ControlState")
        assert all(each["type"] != "CameraPicture" for each in other.seen)
    wait(lambda: not camera.is_open)  # the page is gone
