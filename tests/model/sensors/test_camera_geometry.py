"""Points, pixels and the floor: against OpenCV, numerical Jacobians and laws."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from robotctl.config.robot_file import find_file, load_robot
from robotctl.model.sensors.camera import CameraConfig, CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry, mount_of_pose
from robotctl.model.sensors.camera_lens import camera_matrix, straightened, undistort

LENS = CameraIntrinsics(640, 480, 530.0, 540.0, 330.0, 235.0, (-0.25, 0.09, 0.002, -0.001, -0.02))
PLAIN = replace(LENS, distortion=(0.0,) * 5)
MOUNT = CameraMount(0.12, -0.03, 0.31, 8.0, 24.0, -3.0)
CAMERA = CameraGeometry(LENS, MOUNT)

mounts = st.builds(
    CameraMount,
    x_m=st.floats(-0.5, 0.5),
    y_m=st.floats(-0.5, 0.5),
    z_m=st.floats(0.05, 2.0),
    yaw_deg=st.floats(-180.0, 180.0),
    pitch_deg=st.floats(-20.0, 89.0),
    roll_deg=st.floats(-60.0, 60.0),
)
lenses = st.builds(
    CameraIntrinsics,
    width_px=st.just(640),
    height_px=st.just(480),
    fx_px=st.floats(250.0, 1200.0),
    fy_px=st.floats(250.0, 1200.0),
    cx_px=st.floats(280.0, 360.0),
    cy_px=st.floats(200.0, 280.0),
    distortion=st.tuples(
        st.floats(-0.3, 0.3),
        st.floats(-0.1, 0.1),
        st.floats(-0.005, 0.005),
        st.floats(-0.005, 0.005),
        st.floats(-0.02, 0.02),
    ),
)


def pixel_grid(step: int = 40) -> NDArray[np.float64]:
    u, v = np.meshgrid(np.arange(0.0, 640.0, step), np.arange(0.0, 480.0, step))
    return np.column_stack([u.ravel(), v.ravel()])


def opencv_pose(camera: CameraGeometry) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    R = camera.R_base_camera.T
    return Rotation.from_matrix(R).as_rotvec(), -R @ camera.t_base_camera


def test_a_camera_that_looks_forward_sees_left_points_left_and_high_points_high() -> None:
    camera = CameraGeometry(PLAIN, CameraMount(0.0, 0.0, 0.3))
    ahead, left, high = camera.project(
        np.array([[2.0, 0.0, 0.3], [2.0, 0.5, 0.3], [2.0, 0.0, 0.8]])
    )
    assert ahead == pytest.approx((330.0, 235.0))
    assert left == pytest.approx((330.0 - 530.0 * 0.25, 235.0))
    assert high == pytest.approx((330.0, 235.0 - 540.0 * 0.25))


def test_the_axis_of_a_camera_pitched_down_meets_the_floor_at_height_over_tangent() -> None:
    camera = CameraGeometry(PLAIN, CameraMount(0.1, 0.0, 0.3, pitch_deg=30.0))
    centre = np.array([[330.0, 235.0]])
    assert camera.ground(centre)[0] == pytest.approx((0.1 + 0.3 / math.tan(math.pi / 6), 0.0))


def test_a_camera_that_leans_right_sees_what_is_left_of_it_lower_in_the_picture() -> None:
    level = CameraGeometry(PLAIN, CameraMount(0.0, 0.0, 0.3))
    leaning = CameraGeometry(PLAIN, CameraMount(0.0, 0.0, 0.3, roll_deg=10.0))
    left = np.array([[2.0, 0.5, 0.3]])
    # The picture of a camera turned clockwise turns counter-clockwise: its left side comes down.
    assert leaning.project(left)[0, 1] > level.project(left)[0, 1] + 10.0


@given(lens=lenses, mount=mounts)
def test_projection_agrees_with_opencv(lens: CameraIntrinsics, mount: CameraMount) -> None:
    camera = CameraGeometry(lens, mount)
    rng = np.random.default_rng(1)
    in_camera = np.column_stack([rng.uniform(-0.4, 0.4, (50, 2)), np.ones(50)])
    in_camera *= rng.uniform(0.2, 5.0, (50, 1))
    points = in_camera @ camera.R_base_camera.T + camera.t_base_camera
    rotation, translation = opencv_pose(camera)
    distortion = np.array(lens.distortion)
    expected, _ = cv2.projectPoints(points, rotation, translation, camera_matrix(lens), distortion)
    ours = camera.project(points)
    seen = np.isfinite(ours[:, 0])
    assert seen.sum() >= 10
    assert ours[seen] == pytest.approx(expected.reshape(-1, 2)[seen], abs=1e-6)


def test_undistortion_agrees_with_opencv_where_that_converges() -> None:
    pixels = pixel_grid()
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    expected = cv2.undistortPoints(
        pixels, camera_matrix(LENS), np.array(LENS.distortion), criteria=criteria
    )
    assert CAMERA.rays(pixels)[:, :2] == pytest.approx(expected.reshape(-1, 2), abs=1e-7)


@given(lens=lenses, mount=mounts)
def test_a_point_of_the_floor_comes_back_from_its_pixel(
    lens: CameraIntrinsics, mount: CameraMount
) -> None:
    camera = CameraGeometry(lens, mount)
    pixels = pixel_grid(80)
    ground = camera.ground(pixels)
    seen = np.isfinite(ground[:, 0]) & (np.abs(ground).max(axis=1) < 100.0)
    assert camera.project_ground(ground[seen]) == pytest.approx(pixels[seen], abs=1e-6)


@given(mount=mounts)
def test_mount_and_pose_are_two_forms_of_the_same(mount: CameraMount) -> None:
    camera = CameraGeometry(LENS, mount)
    again = mount_of_pose(camera.R_base_camera, camera.t_base_camera)
    assert CameraGeometry(LENS, again).R_base_camera == pytest.approx(
        camera.R_base_camera, abs=1e-9
    )
    assert (again.x_m, again.y_m, again.z_m) == (mount.x_m, mount.y_m, mount.z_m)
    assert again.pitch_deg == pytest.approx(mount.pitch_deg, abs=1e-6)


def test_a_camera_that_looks_straight_down_has_a_mount_without_roll() -> None:
    camera = CameraGeometry(LENS, CameraMount(0.0, 0.0, 0.5, 30.0, 90.0, 10.0))
    again = mount_of_pose(camera.R_base_camera, camera.t_base_camera)
    assert again.roll_deg == 0.0
    assert CameraGeometry(LENS, again).R_base_camera == pytest.approx(
        camera.R_base_camera, abs=1e-9
    )


def test_the_homography_maps_the_floor_as_the_lens_without_distortion_does() -> None:
    ground = np.array([[0.5, 0.1], [1.0, -0.4], [3.0, 1.0]])
    mapped = np.column_stack([ground, np.ones(3)]) @ CAMERA.homography().T
    straight = CameraGeometry(PLAIN, MOUNT).project_ground(ground)
    assert mapped[:, :2] / mapped[:, 2:] == pytest.approx(straight)
    assert straightened(CAMERA.project_ground(ground), LENS) == pytest.approx(straight)


def test_the_jacobian_of_the_floor_is_the_numerical_one() -> None:
    pixels = pixel_grid(60)
    pixels = pixels[pixels[:, 1] > 100.0]
    ground, J = CAMERA.ground_jacobian(pixels)
    step_px = 1e-4
    for axis, shift in enumerate(np.eye(2) * step_px):
        slope = (CAMERA.ground(pixels + shift) - CAMERA.ground(pixels - shift)) / (2.0 * step_px)
        assert J[:, :, axis] == pytest.approx(slope, rel=1e-5, abs=1e-7)
    assert ground == pytest.approx(CAMERA.ground(pixels))


def test_the_covariance_is_that_of_many_noisy_pixels() -> None:
    rng = np.random.default_rng(2)
    pixel = np.array([[200.0, 300.0]])
    _, P = CAMERA.ground_covariance(pixel, 0.5)
    drawn = CAMERA.ground(pixel + rng.normal(scale=0.5, size=(20_000, 2)))
    assert P[0] == pytest.approx(np.cov(drawn.T), rel=0.05, abs=1e-8)


def test_pixels_at_the_horizon_and_above_have_no_place_on_the_floor() -> None:
    camera = CameraGeometry(PLAIN, CameraMount(0.0, 0.0, 0.3, pitch_deg=20.0))
    horizon_px = 235.0 - 540.0 * math.tan(math.radians(20.0))
    pixels = np.array([[330.0, horizon_px - 1e-9], [330.0, 0.0], [330.0, horizon_px + 1.0]])
    ground, J = camera.ground_jacobian(pixels)
    assert np.isnan(ground[:2]).all()
    assert np.isnan(J[:2]).all()
    assert ground[2, 0] > 50.0
    assert np.isnan(camera.ground_covariance(pixels, 1.0)[1][:2]).all()


def test_points_behind_the_camera_are_not_seen() -> None:
    behind = np.array([[-1.0, 0.0, 0.0], [0.12, -0.03, 0.31]])
    assert np.isnan(CAMERA.project(behind)).all()


def test_a_point_outside_of_a_lens_that_turns_back_is_not_folded_into_the_picture() -> None:
    # 1 - 0.9 r^2 is 0 at r = 1.054: a point at r = 1.4 would be shown at 0.58.
    folding = CameraGeometry(
        replace(PLAIN, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0)), CameraMount(0.0, 0.0, 0.3)
    )
    assert np.isnan(folding.project(np.array([[1.0, 1.4, 0.3]]))).all()
    beyond = np.array([[0.71, 0.0]])
    assert np.isnan(undistort(beyond, (-0.3, 0.0, 0.0, 0.0, 0.0))[0]).all()


def test_inside_counts_whole_pixels() -> None:
    pixels = np.array([[-0.5, -0.5], [639.4, 479.4], [639.6, 10.0], [10.0, -0.6], [np.nan, 1.0]])
    assert CAMERA.inside(pixels).tolist() == [True, True, False, False, False]


def test_the_camera_of_the_robot_that_comes_along_sees_the_floor_near_and_far() -> None:
    config = load_robot(find_file("diff_drive")).camera
    assert isinstance(config, CameraConfig)
    camera = CameraGeometry.of(config)
    floor = np.array([[0.45, 0.0], [1.0, 0.3], [3.0, -1.0], [10.0, 0.0]])
    assert camera.inside(camera.project_ground(floor)).all()
    assert np.isfinite(camera.rays(pixel_grid(20))).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"z_m": 0.0}, "above the floor"),
        ({"z_m": math.nan}, "z_m must be finite"),
        ({"pitch_deg": 91.0}, "-90 to 90"),
    ],
)
def test_a_mount_that_cannot_be_is_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(MOUNT, **change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width_px": 0}, "width_px must be 1"),
        ({"fx_px": -1.0}, "fx_px must be > 0"),
        ({"cy_px": math.inf}, "cy_px must be finite"),
        ({"distortion": (0.0, 0.1)}, "five finite numbers"),
    ],
)
def test_a_lens_that_cannot_be_is_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(LENS, **change)
