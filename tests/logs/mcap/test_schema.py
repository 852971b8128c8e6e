"""Messages as JSON and their schemas: nothing that JSON cannot say, and Foxglove's own fields."""

import base64
import enum
import io
import json
import math
from array import array
from collections.abc import Callable
from typing import Any

import foxglove.messages
import jsonschema
import msgspec
import pytest
from foxglove_schemas_protobuf import (
    FrameTransforms_pb2,
    Grid_pb2,
    LaserScan_pb2,
    LinePrimitive_pb2,
    Log_pb2,
    PointCloud_pb2,
    PoseInFrame_pb2,
    SceneEntityDeletion_pb2,
    SceneUpdate_pb2,
)
from google.protobuf.descriptor import Descriptor, EnumDescriptor, FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from hypothesis import given
from hypothesis import strategies as st

from robotctl.logs.formats.robotctl_messages import logged_scan, logged_state
from robotctl.logs.mcap.entries import TOPICS, LogEntries
from robotctl.logs.mcap.forms import (
    camera_content,
    camera_schema,
    control_content,
    control_schema,
)
from robotctl.logs.mcap.foxglove import scan_ranges
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.scene import Scene
from robotctl.logs.mcap.scene_update import LineType, SceneEntityDeletionType
from robotctl.logs.mcap.schema import plain, schema_of
from robotctl.messages.control import BatteryFeedback, NavigationState, Notice
from robotctl.messages.estimation import (
    CameraView,
    ClosedLoop,
    GivenMap,
    LidarScan,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    PlanView,
    SeenMarker,
    SeenObstacle,
    SlamGraph,
)
from robotctl.model.footprint import Footprint
from robotctl.model.sensors.sonar import SonarMount
from tests.logs.mcap.schema_check import checked_topics
from tests.logs.mcap.test_log import FULL
from tests.mavlink.conftest import CONTROL, NAVIGATION

PUBLISHED: dict[str, Descriptor] = {
    "foxglove.FrameTransforms": FrameTransforms_pb2.FrameTransforms.DESCRIPTOR,
    "foxglove.PoseInFrame": PoseInFrame_pb2.PoseInFrame.DESCRIPTOR,
    "foxglove.Grid": Grid_pb2.Grid.DESCRIPTOR,
    "foxglove.PointCloud": PointCloud_pb2.PointCloud.DESCRIPTOR,
    "foxglove.LaserScan": LaserScan_pb2.LaserScan.DESCRIPTOR,
    "foxglove.Log": Log_pb2.Log.DESCRIPTOR,
    "foxglove.SceneUpdate": SceneUpdate_pb2.SceneUpdate.DESCRIPTOR,
}
OPTIONAL = {"name", "sweep_s"}
"""Our own that a scan of the only lidar, or of one that does not sweep, leaves out."""
ADDED = {"foxglove.LaserScan": {"max_range", *OPTIONAL}, "foxglove.PoseInFrame": {"theta_rad"}}
"""Our own, beside what is published."""

KINDS = {
    FieldDescriptor.TYPE_DOUBLE: "number",
    FieldDescriptor.TYPE_BOOL: "boolean",
    FieldDescriptor.TYPE_STRING: "string",
    FieldDescriptor.TYPE_BYTES: "string",
    FieldDescriptor.TYPE_FIXED32: "integer",
    FieldDescriptor.TYPE_ENUM: "integer",
    FieldDescriptor.TYPE_MESSAGE: "object",
}
FLOATS = st.floats()


def agrees(schema: dict[str, Any], published: Descriptor, added: set[str]) -> None:
    """Check that a schema has the fields that are published, and all of them required."""
    assert set(schema["properties"]) - added == set(published.fields_by_name)
    assert set(schema["required"]) == set(schema["properties"]) - (added & OPTIONAL)
    for field in published.fields:
        part = schema["properties"][field.name]
        if field.is_repeated:
            assert part["type"] == "array"
            part = part["items"]
        assert part["type"] == KINDS[field.type], field.full_name
        assert ("contentEncoding" in part) == (field.type == FieldDescriptor.TYPE_BYTES)
        if field.message_type is None:
            continue
        if field.message_type.file.package == "google.protobuf":  # Timestamp, Duration
            assert set(part["properties"]) == {"sec", "nsec"}  # as JSON has it
        else:
            agrees(part, field.message_type, set())


def of_the_sdk(name: str) -> Descriptor:
    """Return a message as Foxglove's own SDK publishes it."""
    schema = getattr(foxglove.messages, name.removeprefix("foxglove.")).get_schema()
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)  # type: ignore[no-untyped-call]
    return pool.FindMessageTypeByName(name)


@pytest.mark.parametrize("published", [PUBLISHED.__getitem__, of_the_sdk])
def test_well_known_messages_have_the_fields_that_foxglove_publishes(
    published: Callable[[str], Descriptor],
) -> None:
    found = {name: schema for name, schema in TOPICS.values() if name.startswith("foxglove.")}
    assert set(found) == set(PUBLISHED)
    for name, schema in found.items():
        agrees(schema, published(name), ADDED.get(name, set()))


@pytest.mark.parametrize(
    ("ours", "published"),
    [
        (LineType, LinePrimitive_pb2.LinePrimitive.DESCRIPTOR.enum_types_by_name["Type"]),
        (
            SceneEntityDeletionType,
            SceneEntityDeletion_pb2.SceneEntityDeletion.DESCRIPTOR.enum_types_by_name["Type"],
        ),
    ],
)
def test_enumerations_have_the_numbers_that_foxglove_publishes(
    ours: type[enum.IntEnum], published: EnumDescriptor
) -> None:
    assert {each.name: each.value for each in ours} == {
        each.name: each.number for each in published.values
    }


MOVING = ((1.0, 2.0, 0.5, -0.5, 0.3),)
SONARS = tuple(SonarMount(f"sonar{i}", 0.1, 0.0, 45.0 * i) for i in range(8))


def everything() -> list[msgspec.Struct]:
    """Return a message of each kind, with all that may be missing or infinite."""
    odd = (math.inf, math.nan, 1.0)
    things = tuple(SeenObstacle(1.0, 0.0, (each, 0.0, 0.1), 0.2) for each in (0.1, math.inf))
    view = CameraView(
        4, 0.1, 0.0, 3.0, (0.0, 0.1, 0.2), odd, (math.nan, math.nan, 0.1), (0.3, 0.3, math.inf),
        things, step_us=math.nan, markers=(SeenMarker(7, 1.0, 0.0, 0.1),),
    )  # fmt: skip
    belief = LocalisationState(5, "mcl", 0, 1.0, 2.0, 0.5, (math.nan,) * 6)  # type: ignore[arg-type]
    sure = msgspec.structs.replace(
        belief, covariance=(0.1, 0.0, 0.0, 0.2, 0.0, 0.1), loops=(ClosedLoop(1, 0, 1.0, 0.0, 0.0),)
    )
    headed = msgspec.structs.replace(NAVIGATION, goal=(1.0, 2.0), home=(0.0, 0.0, 1.0))
    scan = LidarScan(6, 0.1, 0.0, -1.0, 0.5, 8.0, _float32(1.0, math.inf, math.nan, -math.inf))
    chart = LiveMap(7, 2, 3, 0.05, -1.0, -2.0, bytes([0, 100, 255, 50, 0, 255]), 0.3)
    nowhere = msgspec.structs.replace(
        FULL, v_m_s=math.nan, odometer_m=math.inf, wheel_rad_s=(math.nan, 1.0), battery=None
    )
    return [
        FULL, nowhere, CONTROL, headed, NAVIGATION, view, sure, belief, scan, chart,
        GivenMap(8, chart),
        ParticleCloud(9, _float32(1.0, 2.0, 3.0)),
        PlanView(9, _float32(1.0, 2.0, 3.0), b"", _float32(1.0, 2.0), MOVING, chart),
        GRAPH,
        Notice(10, 2, "stopped"),
    ]  # fmt: skip


def _float32(*values: float) -> bytes:
    return array("f", values).tobytes()


GRAPH = SlamGraph(
    11,
    _float32(0.0, 0.0, 0.1, 1.0, 0.5, 0.2, 2.0, 1.0, 0.3),
    array("i", [0, 1, 1, 2]).tobytes(),
    array("i", [0, 2]).tobytes(),
)


def test_a_graph_is_the_links_between_its_keyframes_by_their_numbers() -> None:
    entries = [*LogEntries(0, "rover", Scene()).of(GRAPH)]
    (drawing,) = (make() for topic, _, make in entries if topic == "slam_graph")
    links, loops = drawing.entities[0].lines
    assert [(each.x, each.y) for each in links.points] == [(0.0, 0.0), (1.0, 0.5), (2.0, 1.0)]
    assert (links.indices, loops.indices) == ((0, 1, 1, 2), (0, 2))
    assert links.color != loops.color


def test_a_graph_is_drawn_again_only_once_it_has_changed_and_in_each_file() -> None:
    scene = Scene()

    def drawn(entries: LogEntries, stamp_s: int, loops: bytes = GRAPH.loops) -> int:
        graph = msgspec.structs.replace(GRAPH, stamp_ns=stamp_s * 10**9, loops=loops)
        return [topic for topic, *_ in entries.of(graph)].count("slam_graph")

    entries = LogEntries(0, "rover", scene)
    assert drawn(entries, 1) == 1
    assert drawn(entries, 20) == 0, "nothing has changed"
    assert drawn(entries, 21, b"") == 1
    assert drawn(entries, 22) == 0, "too soon"
    assert drawn(entries, 27) == 1
    assert drawn(LogEntries(0, "rover", scene), 28) == 1, "another file begins with it"


def test_every_message_fits_the_schema_in_the_file() -> None:
    file = io.BytesIO()
    scene = Scene(SONARS, bodies=(Footprint.rectangle(-0.2, 0.2, 0.15),))
    log = McapLog(file, 1_700_000_000_000_000_000, "rover", scene)
    for message in everything():
        log.add(message)
    log.close()
    file.seek(0)
    assert set(checked_topics(file)) == set(TOPICS)


def test_a_validator_finds_null_where_a_number_is_declared() -> None:
    content = json.loads(msgspec.json.encode(control_content(CONTROL, ())))
    jsonschema.validate(content, control_schema())
    with pytest.raises(jsonschema.ValidationError, match="None is not of type 'number'"):
        jsonschema.validate({**content, "v_m_s": None}, control_schema())


def test_the_schema_names_every_field() -> None:
    assert tuple(schema_of(NavigationState)["properties"]) == NavigationState.__struct_fields__


def test_numbers_of_an_enumeration_are_put_into_words() -> None:
    words = control_schema()["properties"]["state"]["description"]
    assert words.startswith("0 boot, 1 standby, 2 armed, 3 driving")


def test_a_type_without_a_schema_is_refused() -> None:
    with pytest.raises(TypeError, match="no JSON schema"):
        schema_of(complex)


@given(FLOATS, FLOATS)
def test_numbers_survive_json_to_the_bit_and_others_are_left_out(
    voltage_v: float, current_a: float
) -> None:
    battery = BatteryFeedback(0, voltage_v, current_a, 0.5, 20.0, low=False, critical=False)
    back = json.loads(msgspec.json.encode(plain(battery)))
    assert back.get("current_a", math.nan) == pytest.approx(
        current_a if math.isfinite(current_a) else math.nan, abs=0.0, nan_ok=True
    )
    assert ("voltage_v" in back) == math.isfinite(voltage_v)


@given(st.lists(FLOATS, min_size=2, max_size=2))
def test_a_list_in_which_a_number_is_missing_is_left_out(wheels: list[float]) -> None:
    content = control_content(msgspec.structs.replace(CONTROL, wheel_rad_s=tuple(wheels)), ())
    assert content.get("wheel_rad_s") == (
        tuple(wheels) if all(map(math.isfinite, wheels)) else None
    )


@given(st.lists(st.floats(min_value=0.0) | st.just(math.nan), min_size=8, max_size=8))
def test_sonar_ranges_are_read_back_as_they_were(ranges_m: list[float]) -> None:
    state = msgspec.structs.replace(
        CONTROL, sonar_m=tuple(ranges_m), sonar_stamp_ns=tuple(range(8))
    )
    content = control_content(state, ("front",))
    jsonschema.validate(json.loads(msgspec.json.encode(content)), control_schema())
    back = logged_state(msgspec.json.encode(content))
    assert back.sonar_m == pytest.approx(state.sonar_m, abs=0.0, nan_ok=True)
    assert back.sonar_stamp_ns == state.sonar_stamp_ns


@given(st.lists(st.floats(0.0, 100.0, width=32) | st.sampled_from([math.inf, math.nan])))
def test_ranges_of_a_scan_are_read_back_to_a_tenth_of_a_millimetre(ranges_m: list[float]) -> None:
    written = scan_ranges(ranges_m)
    assert all(map(math.isfinite, written))
    place = {"pose": {"position": {"x": 0.0, "y": 0.0}}}
    limits = {"start_angle": 0.0, "end_angle": 1.0, "max_range": 100.0}
    back = logged_scan(msgspec.json.encode({**place, **limits, "ranges": written})).ranges_m
    assert back == pytest.approx(ranges_m, abs=0.6e-4, nan_ok=True)


def test_a_beam_of_the_camera_without_a_range_says_whether_the_floor_goes_on() -> None:
    view = CameraView(
        0, 0.1, 0.0, 3.0, (0.0, 0.1, 0.2), (math.inf, math.nan, 1.5), (math.nan, math.nan, 0.1),
        (0.3, 0.3, 0.3),
    )  # fmt: skip
    content = camera_content(view)
    jsonschema.validate(json.loads(msgspec.json.encode(content)), camera_schema())
    assert content["beams"] == [
        {"angle_rad": 0.0, "out_of_range": True, "nearest_m": 0.3},
        {"angle_rad": 0.1, "out_of_range": False, "nearest_m": 0.3},
        {"angle_rad": 0.2, "range_m": 1.5, "out_of_range": False, "sigma_m": 0.1, "nearest_m": 0.3},
    ]


def test_bytes_are_base64_as_their_schema_says() -> None:
    schema = schema_of(bytes)
    assert schema == {"type": "string", "contentEncoding": "base64"}
    assert base64.b64decode(json.loads(msgspec.json.encode(b"\x00\xff\x10"))) == b"\x00\xff\x10"
