"""What a 3D panel draws: shapes that stand where the geometry of the messages says."""

import io
import json
import math
from collections import Counter
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.logs.mcap.entries import LogEntries
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.scene import Scene
from robotctl.logs.mcap.table import rows_of
from robotctl.messages.control import ControlState, Mode, NavigationState
from robotctl.messages.estimation import (
    CameraView,
    ClosedLoop,
    LiveMap,
    LocalisationState,
    PlanView,
    SeenMarker,
    SeenObstacle,
)
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from tests.mavlink.conftest import CONTROL, NAVIGATION

BODY = Footprint.rectangle(-0.3, 0.2, 0.15)
SONARS = (SonarMount("left", 0.1, 0.05, 90.0), SonarMount("rear", -0.2, 0.0, 180.0))
LENGTHS = st.floats(-50.0, 50.0)
POSES = st.builds(SE2, LENGTHS, LENGTHS, st.floats(-math.pi, math.pi))
S = 1_000_000_000


class Viewer:
    """What a panel shows of a run: the entities of each topic, by the rules of SceneUpdate."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.shown: dict[str, dict[str, dict[str, Any]]] = {}
        self.updates: Counter[str] = Counter()
        self.begin()

    def begin(self) -> None:
        """Open the next file of the run, which shows nothing yet."""
        self.entries = LogEntries(0, "rover", self.scene)
        self.shown.clear()

    def see(self, *messages: Any) -> None:
        for message in messages:
            for topic, _, make in self.entries.of(message):
                value = json.loads(msgspec.json.encode(make()))
                if "entities" not in value:
                    continue
                self.updates[topic] += 1
                known = self.shown.setdefault(topic, {})
                for each in value["deletions"]:
                    assert each["type"] == 1  # ALL
                    known.clear()
                known.update((each["id"], each) for each in value["entities"])


def viewer(**options: Any) -> Viewer:
    return Viewer(Scene(SONARS, bodies=(BODY,), **options))


def control(stamp_ns: int, *ranges_m: float, at: SE2 | None = None) -> ControlState:
    at = at or SE2()
    return msgspec.structs.replace(
        CONTROL, stamp_ns=stamp_ns, sonar_m=ranges_m, sonar_stamp_ns=(0,) * len(ranges_m),
        x_m=at.x_m, y_m=at.y_m, theta_rad=at.theta_rad,
    )  # fmt: skip


def belief(stamp_ns: int, place: SE2, covariance: tuple[float, ...], *loops: ClosedLoop) -> Any:
    return LocalisationState(
        stamp_ns, "slam", LocalisationStatus.LOCALISED, place.x_m, place.y_m, place.theta_rad,
        covariance, loops=loops,
    )  # fmt: skip


def placed(pose: dict[str, Any], point: dict[str, float]) -> np.ndarray:
    """Return a point of a primitive in the frame of its entity; all poses are turns about z."""
    place, turn = pose["position"], pose["orientation"]
    assert turn["x"] == turn["y"] == 0.0
    angle = 2.0 * math.atan2(turn["z"], turn["w"])
    c, s = math.cos(angle), math.sin(angle)
    return np.array([place["x"] + c * point["x"] - s * point["y"],
                     place["y"] + s * point["x"] + c * point["y"]])  # fmt: skip


@given(st.floats(0.01, 1.0), st.floats(0.01, 1.0), st.floats(-0.9, 0.9), LENGTHS, LENGTHS)
def test_the_ellipse_holds_95_percent_of_what_its_covariance_draws(
    sigma_x: float, sigma_y: float, correlation: float, x_m: float, y_m: float
):
    xy = correlation * sigma_x * sigma_y
    seen = viewer()
    seen.see(control(0), belief(1, SE2(x_m, y_m), (sigma_x**2, xy, 0.0, sigma_y**2, 0.0, 0.01)))
    (shape,) = seen.shown["covariance"]["covariance"]["cylinders"]
    cov = [[sigma_x**2, xy], [xy, sigma_y**2]]
    drawn = np.random.default_rng(7).multivariate_normal([x_m, y_m], cov, 4000)
    centre = placed(shape["pose"], {"x": 0.0, "y": 0.0})
    axes = np.stack([placed(shape["pose"], {"x": 1.0, "y": 0.0}) - centre,
                     placed(shape["pose"], {"x": 0.0, "y": 1.0}) - centre])  # fmt: skip
    along = (drawn - centre) @ axes.T / np.array([shape["size"]["x"], shape["size"]["y"]]) * 2.0
    inside = np.mean(np.hypot(*along.T) <= 1.0)
    assert inside == pytest.approx(0.95, abs=0.025)


@given(POSES, POSES, POSES)
def test_a_closed_loop_is_drawn_between_the_places_where_the_robot_was(
    T_world_odom: SE2, first: SE2, second: SE2
):
    between = first.inverse() @ second
    loop = ClosedLoop(20 * S, 1 * S, between.x_m, between.y_m, between.theta_rad)
    seen = viewer()
    seen.see(
        control(1 * S, at=first), control(20 * S, at=second), control(22 * S, at=SE2()),
        belief(22 * S, T_world_odom, (0.1, 0.0, 0.0, 0.1, 0.0, 0.1), loop),
    )  # fmt: skip
    (line,) = seen.shown["loops"]["loops"]["lines"]
    assert line["type"] == 2  # pairs of points
    ends = [(point["x"], point["y"]) for point in line["points"]]
    expected = [T_world_odom @ each for each in (first, second)]
    np.testing.assert_allclose(ends, [(p.x_m, p.y_m) for p in expected], atol=2e-3)


def test_closed_loops_and_the_outline_are_in_every_file_of_a_run():
    seen = viewer()
    loop = ClosedLoop(1, 0, 1.0, 0.0, 0.0)
    seen.see(control(1), belief(2, SE2(), (0.1,) * 6, loop), belief(3, SE2(), (0.1,) * 6, loop))
    assert len(seen.shown["loops"]["loops"]["lines"][0]["points"]) == 4
    before = dict(seen.shown["loops"]["loops"], timestamp=None)
    seen.begin()
    seen.see(control(4))
    assert dict(seen.shown["loops"]["loops"], timestamp=None) == before
    body, nose = (
        np.array([(point["x"], point["y"]) for point in line["points"]])
        for line in seen.shown["outline"]["outline"]["lines"]
    )
    assert body.tolist() == [list(corner) for corner in BODY.corners]
    assert nose[:, 0].max() > BODY.front_m
    assert seen.shown["outline"]["outline"]["frame_locked"] is True


def test_nothing_is_drawn_of_odometry_that_is_not_the_localisers():
    seen = viewer()
    restarted = msgspec.structs.replace(control(S), odom_epoch_ns=S)
    seen.see(control(0), restarted, belief(2 * S, SE2(), (0.1,) * 6, ClosedLoop(1, 0, 1.0, 0, 0)))
    assert "loops" not in seen.shown
    assert "covariance" not in seen.shown
    new = msgspec.structs.replace(
        belief(3 * S, SE2(), (0.1,) * 6, ClosedLoop(1, 0, 1.0, 0, 0)), odom_epoch_ns=S
    )
    seen.see(new)
    assert "covariance" in seen.shown
    assert "loops" not in seen.shown  # closed by the odometry before the restart


@given(st.floats(0.05, 3.9))
def test_a_cone_reaches_as_far_as_the_sonar_has_measured(range_m: float):
    seen = viewer(sonar=SonarModelConfig(beam_deg=30.0, max_range_m=4.0))
    seen.see(control(0, range_m, math.inf))
    near, far = seen.shown["sonar_cones"]["sonars"]["lines"]
    assert far["color"]["a"] < near["color"]["a"]
    for mount, line, reach_m in zip(SONARS, (near, far), (range_m, 4.0), strict=True):
        apex, *arc = (placed(line["pose"], point) for point in line["points"])
        np.testing.assert_allclose(apex, (mount.x_m, mount.y_m), atol=1e-3)
        offsets = np.array(arc) - apex
        np.testing.assert_allclose(np.hypot(*offsets.T), reach_m, atol=7e-3)  # cm and mm
        bearings = np.degrees(np.arctan2(offsets[:, 1], offsets[:, 0]))
        away = np.abs((bearings - mount.heading_deg + 180.0) % 360.0 - 180.0)
        assert away.max() == pytest.approx(15.0, abs=1.5)


def test_cones_are_drawn_seldom_and_only_when_they_change_and_not_without_a_reading():
    seen = viewer()
    for tick in range(100):
        seen.see(control(tick * S // 50, 1.0, math.nan))
    assert seen.updates["sonar_cones"] == 1
    assert len(seen.shown["sonar_cones"]["sonars"]["lines"]) == 1
    for tick in range(100, 200):
        seen.see(control(tick * S // 50, 1.0 + tick / 50, math.nan))
    assert seen.updates["sonar_cones"] == 5


def plan(stamp_ns: int, *moving: tuple[float, float, float, float, float]) -> PlanView:
    chart = LiveMap(stamp_ns, 1, 1, 0.05, 0.0, 0.0, b"\0")
    return PlanView(stamp_ns, b"", b"", b"", moving, chart)


@given(LENGTHS, LENGTHS, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.1, 1.0))
def test_the_arrow_of_what_moves_ends_where_it_will_be_in_a_second(
    x_m: float, y_m: float, vx: float, vy: float, radius_m: float
):
    seen = viewer()
    seen.see(plan(0, (x_m, y_m, vx, vy, radius_m), (0.0, 0.0, 1.0, 0.0, 0.3)))
    assert len(seen.shown["moving"]) == 2
    entity = seen.shown["moving"]["moving 0"]
    (body,), (arrow,) = entity["cylinders"], entity["arrows"]
    assert body["size"]["x"] == body["size"]["y"] == pytest.approx(2.0 * radius_m, abs=1e-3)
    length_m = arrow["shaft_length"] + arrow["head_length"]
    tip = placed(arrow["pose"], {"x": length_m, "y": 0.0})
    np.testing.assert_allclose(tip, (x_m + vx, y_m + vy), atol=5e-3)
    told = {each["key"]: float(each["value"]) for each in entity["metadata"]}
    assert (told["vx_m_s"], told["vy_m_s"]) == pytest.approx((vx, vy), abs=1e-3)
    life = entity["lifetime"]
    assert 0.2 < life["sec"] + life["nsec"] / 1e9 < 1.0  # one view of the plan, and a second


def test_what_moves_no_more_is_told_once():
    seen = viewer()
    seen.see(plan(0), plan(1, (0.0,) * 5), plan(2), plan(3))
    assert seen.updates["moving"] == 2


def test_the_camera_sees_the_floor_end_where_its_beams_say():
    angles = (-0.2, -0.1, 0.0, 0.1, 0.2)
    ranges = (1.0, 1.1, math.nan, 1.2, 1.3)
    thing, marker = SeenObstacle(1.1, 1.0, (0.1, 0.0, 0.1), 0.4), SeenMarker(7, 1.0, 0.5, 0.25)
    view = CameraView(
        0, 0.1, 0.0, 3.0, angles, ranges, (0.1,) * 5, (0.1,) * 5, (thing,), markers=(marker,)
    )
    seen = viewer()
    seen.see(view, msgspec.structs.replace(view, stamp_ns=S, trouble="dark"))
    assert seen.updates["seen"] == 1
    entity = seen.shown["seen"]["seen"]
    assert entity["frame_id"] == "base"
    first, second = ([(p["x"], p["y"]) for p in line["points"]] for line in entity["lines"])
    expected = [
        (0.1 + r * math.cos(a), r * math.sin(a)) for a, r in zip(angles, ranges, strict=True)
    ]
    np.testing.assert_allclose([*first, *second], expected[:2] + expected[3:], atol=1e-3)
    (body,) = entity["cylinders"]
    centre = placed(body["pose"], {"x": 0.0, "y": 0.0})
    sight = np.array([1.0, 1.0]) / math.sqrt(2.0)  # from the camera to the thing
    np.testing.assert_allclose(centre - 0.2 * sight, (1.1, 1.0), atol=2e-3)
    assert [each["text"] for each in entity["texts"]] == ["7"]


def driving(stamp_ns: int, goal: tuple[float, float] | None, **more: Any) -> NavigationState:
    return msgspec.structs.replace(
        NAVIGATION, stamp_ns=stamp_ns, mode=Mode.AUTO, mission="tour", item_name="dock", goal=goal,
        **more,
    )  # fmt: skip


def test_the_goal_is_drawn_when_it_changes_and_gone_when_there_is_none():
    seen = viewer()
    seen.see(driving(0, (1.0, 2.0)), driving(1, (1.0, 2.0)))
    assert seen.updates["goal"] == 1
    goal = seen.shown["goal"]["goal"]
    place = goal["cylinders"][0]["pose"]["position"]
    assert (goal["frame_id"], place["x"], place["y"]) == ("world", 1.0, 2.0)
    assert goal["texts"][0]["text"] == "dock"
    seen.see(driving(2, (3.0, 2.0), home=(0.5, 0.0, 1.0)))
    assert set(seen.shown["goal"]) == {"goal", "home"}
    seen.begin()
    seen.see(control(3))
    assert set(seen.shown["goal"]) == {"goal", "home"}
    seen.see(driving(4, None, home=(0.5, 0.0, 1.0)))
    assert set(seen.shown["goal"]) == {"home"}
    seen.see(driving(5, None), driving(6, None))
    assert not seen.shown["goal"]


def test_drawings_are_no_rows_of_tables():
    file = io.BytesIO()
    log = McapLog(file, 0, "rover", Scene(SONARS, bodies=(BODY,)))
    log.add(control(0, 1.0, 1.0))
    log.close()
    file.seek(0)
    tables = {
        channel.topic: list(rows_of(json.loads(message.data)))
        for _, channel, message in make_reader(file).iter_messages()
    }
    assert tables["control"]
    assert tables["outline"] == tables["sonar_cones"] == []


def test_topics_of_one_schema_share_it():
    file = io.BytesIO()
    log = McapLog(file, 0, "rover", Scene(SONARS, bodies=(BODY,)))
    log.add(control(0, 1.0, 1.0))
    log.close()
    file.seek(0)
    summary = make_reader(file).get_summary()
    assert summary is not None
    names = [schema.name for schema in summary.schemas.values()]
    assert len(names) == len(set(names))
    of_topic = {
        each.topic: summary.schemas[each.schema_id].name for each in summary.channels.values()
    }
    assert of_topic["goal"] == of_topic["moving"] == "foxglove.SceneUpdate"
    assert of_topic["map"] == of_topic["live_map"] == "foxglove.Grid"


def test_a_body_that_changes_is_drawn_anew_and_in_the_files_that_follow():
    loaded = Footprint.rectangle(-0.5, 0.4, 0.4)
    seen = Viewer(Scene(SONARS, bodies=(BODY, loaded)))
    seen.see(control(0), NAVIGATION)

    def corners():
        line = seen.shown["outline"]["outline"]["lines"][0]
        return [(point["x"], point["y"]) for point in line["points"]]

    assert corners() == list(BODY.corners)
    for state in (1, 1):
        seen.see(msgspec.structs.replace(NAVIGATION, body=state))
    assert corners() == list(loaded.corners)
    assert seen.updates["outline"] == 2
    seen.begin()
    seen.see(control(1))
    assert corners() == list(loaded.corners)
