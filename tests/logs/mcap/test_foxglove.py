"""What a 3D panel is told: frames as the house's own geometry has them, maps, particles, scans."""

import math
from array import array

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.logs.mcap.foxglove import FrameTransform, Quaternion, grid, laser_scan, point_cloud
from robotctl.logs.mcap.scene import Scene, camera_transform
from robotctl.messages.estimation import (
    LidarScan,
    LiveMap,
    LocalisationState,
)
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.camera import CameraMount
from robotctl.model.sensors.camera_geometry import rotation_of_mount
from robotctl.model.sensors.sonar import SonarMount
from tests.mavlink.conftest import CONTROL

ANGLES = st.floats(-180.0, 180.0)


def rotated(q: Quaternion, vector: np.ndarray) -> np.ndarray:
    """Return q v q*, by the textbook's cross products."""
    axis = np.array([q.x, q.y, q.z])
    return vector + 2.0 * np.cross(axis, np.cross(axis, vector) + q.w * vector)


def plane(transform: FrameTransform) -> SE2:
    """Return a transform of the plane, from where it takes the x axis."""
    ahead = rotated(transform.rotation, np.array([1.0, 0.0, 0.0]))
    place = transform.translation
    return SE2(place.x, place.y, math.atan2(ahead[1], ahead[0]))


@given(ANGLES, st.floats(-90.0, 90.0), ANGLES)
def test_the_frame_of_the_camera_is_that_of_its_geometry(yaw: float, pitch: float, roll: float):
    mount = CameraMount(0.1, 0.2, 0.3, yaw, pitch, roll)
    found = camera_transform(0, mount)
    axes = np.stack([rotated(found.rotation, each) for each in np.eye(3)], axis=1)
    np.testing.assert_allclose(axes, rotation_of_mount(mount), atol=1e-12)
    place = found.translation
    assert (place.x, place.y, place.z) == (0.1, 0.2, 0.3)
    assert (found.parent_frame_id, found.child_frame_id) == ("base", "camera")


def test_a_sonar_looks_along_x_of_its_frame():
    scene = Scene((SonarMount("front_left", 0.15, 0.1, 45.0),))
    (found,) = scene.sensor_frames(0).transforms
    assert (found.parent_frame_id, found.child_frame_id) == ("base", "sonar_front_left")
    at = plane(found)
    assert (at.x_m, at.y_m, at.theta_rad) == pytest.approx((0.15, 0.1, math.pi / 4))


def belief(x_m: float, y_m: float, theta_rad: float) -> LocalisationState:
    return LocalisationState(
        0, "mcl", LocalisationStatus.LOCALISED, x_m, y_m, theta_rad, (0.0,) * 6
    )


def test_the_pose_in_world_is_that_of_odom_in_world_times_that_of_base_in_odom():
    scene = Scene(has_localiser=True)
    scene.localise(belief(10.0, 20.0, math.pi / 2))
    state = msgspec.structs.replace(CONTROL, x_m=1.0, y_m=2.0, theta_rad=0.25)
    frames, pose = scene.frames(1_500_000_000, state)
    world, odom = frames.transforms
    assert (world.parent_frame_id, world.child_frame_id) == ("world", "odom")
    assert (odom.parent_frame_id, odom.child_frame_id) == ("odom", "base")
    assert pose is not None
    assert pose.frame_id == "world"
    product = plane(world) @ plane(odom)
    at = pose.pose.position
    # A quarter turn to the left: 1 m ahead goes along y, 2 m to the left against x.
    assert (at.x, at.y, pose.theta_rad) == pytest.approx((8.0, 21.0, math.pi / 2 + 0.25))
    assert (product.x_m, product.y_m, product.theta_rad) == pytest.approx(
        (at.x, at.y, pose.theta_rad)
    )
    assert (pose.timestamp.sec, pose.timestamp.nsec) == (1, 500_000_000)


def test_without_a_localiser_world_is_where_the_odometry_began():
    frames, pose = Scene().frames(0, CONTROL)
    assert [each.child_frame_id for each in frames.transforms] == ["odom", "base"]
    assert (pose.pose.position.x, pose.pose.position.y) == (CONTROL.x_m, CONTROL.y_m)


def test_until_the_localiser_speaks_nobody_claims_a_pose_in_world():
    scene = Scene(has_localiser=True)
    frames, pose = scene.frames(0, CONTROL)
    assert [each.child_frame_id for each in frames.transforms] == ["base"]
    assert pose is None


def test_what_was_said_of_the_odometry_before_a_restart_is_void():
    scene = Scene(has_localiser=True)
    scene.localise(belief(10.0, 20.0, 0.0))
    assert scene.frames(0, msgspec.structs.replace(CONTROL, odom_epoch_ns=0))[1] is not None
    assert scene.frames(1, msgspec.structs.replace(CONTROL, odom_epoch_ns=1))[1] is None


def scan(*ranges: float, **changes: float) -> LidarScan:
    return LidarScan(
        0, changes.get("x_m", 0.1), 0.05, changes.get("first_rad", -0.5), 0.25, 12.0,
        array("f", ranges).tobytes(),
    )  # fmt: skip


def test_a_scan_says_nothing_came_back_by_a_range_beyond_its_reach_and_nan_by_one_below_zero():
    found = laser_scan(0, scan(1.5, math.inf, math.nan))
    assert found.ranges == [1.5, 1e6, -1e6]
    assert found.ranges[1] > found.max_range
    assert (found.start_angle, found.end_angle) == (-0.5, 0.0)
    assert (found.pose.position.x, found.pose.position.y) == (0.1, 0.05)


@pytest.mark.parametrize(
    "wrong",
    [
        scan(1.0, x_m=math.nan),
        scan(1.0, first_rad=math.inf),
        msgspec.structs.replace(scan(1.0), max_range_m=math.inf),
        msgspec.structs.replace(scan(1.0), ranges=b"12345"),
    ],
)
def test_what_is_no_scan_is_not_logged(wrong: LidarScan):
    assert laser_scan(0, wrong) is None


def test_the_frame_of_the_lidar_is_told_when_its_place_is_new():
    scene = Scene()
    assert scene.sensor_frames(0) is None
    assert scene.place_lidar(scan(1.0))
    assert not scene.place_lidar(scan(2.0))
    (found,) = scene.sensor_frames(0).transforms
    assert (found.child_frame_id, found.translation.x) == ("lidar", 0.1)


def test_a_map_lies_in_world_with_grey_cells_and_their_percentages():
    cells = np.array([[0, 100, -1], [50, 0, -1]], np.int8)
    found = grid(0, LiveMap(0, 2, 3, 0.05, -1.0, -2.0, cells.tobytes(), math.pi / 2))
    data = np.frombuffer(found.data, np.uint8).reshape(-1, found.row_stride)
    assert data.shape[0] == 2
    assert found.column_count == 3
    values = data.reshape(2, 3, found.cell_stride)
    offsets = {field.name: field.offset for field in found.fields}
    np.testing.assert_array_equal(values[:, :, offsets["occupancy"]].view(np.int8), cells)
    grey = values[:, :, [offsets[name] for name in ("red", "green", "blue")]]
    assert grey[0, 0].tolist() == [254] * 3
    assert grey[0, 1].tolist() == [0] * 3
    assert grey[0, 2].tolist() == [205] * 3
    assert grey[1, 0].tolist() == [127] * 3
    assert (values[:, :, offsets["alpha"]] == 255).all()
    assert (found.frame_id, found.cell_size.x, found.pose.position.x) == ("world", 0.05, -1.0)
    assert found.pose.orientation.z == pytest.approx(math.sin(math.pi / 4))


def test_poses_are_points_of_world():
    poses = np.array([[1.0, 2.0, 0.5], [3.0, 4.0, -0.5]], "<f4")
    found = point_cloud(0, poses.tobytes())
    assert [(field.name, field.offset, field.type) for field in found.fields] == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("theta", 8, 7),
    ]
    points = np.frombuffer(found.data, "<f4").reshape(-1, found.point_stride // 4)
    np.testing.assert_array_equal(points, poses)
    assert found.frame_id == "world"
