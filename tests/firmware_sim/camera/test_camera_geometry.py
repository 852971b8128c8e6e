"""Where things lie in the camera's pictures, against OpenCV and a ray caster that tries all."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_sim.camera.camera import Camera
from firmware_sim.camera.lens import pixel_rays
from firmware_sim.camera.truth import project, sightings, true_ranges
from firmware_sim.config.camera_parameters import CameraMount, Intrinsics
from firmware_sim.errors import SimulationError
from firmware_sim.world.world import World, load_world
from tests.firmware_sim.camera.camera_rig import (
    CLEAN,
    CONFIGS,
    PINHOLE,
    SMALL,
    robot,
    room,
    rotation_base_camera,
    seen_by_opencv,
    to_base,
)

LENS = Intrinsics(640, 480, 457.0, 450.0, 322.0, 236.0, (-0.08, 0.02, 5e-4, -5e-4, 0.001))
BLACK = 'colour = "#000000"\n'
LIT = {"simulation.camera.ambient": 1.0}


@given(
    yaw=st.floats(-180, 180),
    pitch=st.floats(-30, 90),
    roll=st.floats(-40, 40),
    seed=st.integers(0, 99),
)
@example(yaw=144.5620902915391, pitch=90.0, roll=33.37227663995721, seed=0)
def test_points_fall_on_the_pixels_that_opencv_says(
    yaw: float, pitch: float, roll: float, seed: int
) -> None:
    mount = CameraMount(0.1, -0.05, 0.3, yaw, pitch, roll)
    rng = np.random.default_rng(seed)
    ahead = rng.uniform(0.3, 4.0, 20)
    aside = ahead[:, None] * rng.uniform(-0.6, 0.6, (20, 2))
    camera = np.column_stack([aside, ahead])
    points = camera @ rotation_base_camera(mount).T + np.array([0.1, -0.05, 0.3])
    assert project(points, LENS, mount) == pytest.approx(
        seen_by_opencv(points, LENS, mount), abs=1e-6
    )


def test_a_point_behind_the_camera_is_on_no_pixel() -> None:
    mount = CameraMount(0.0, 0.0, 0.3)
    assert np.all(np.isnan(project(np.array([[-1.0, 0.0, 0.0]]), LENS, mount)))


@pytest.mark.parametrize("angles", [(0.0, 22.0, 0.0), (40.0, 35.0, -12.0), (180.0, 90.0, 5.0)])
def test_the_ray_of_each_pixel_comes_back_to_its_pixel(angles: tuple[float, float, float]) -> None:
    mount = CameraMount(0.0, 0.0, 0.3, *angles)
    rays = pixel_rays(LENS, mount)
    c, s = math.cos(math.radians(angles[0])), math.sin(math.radians(angles[0]))
    ahead, left = rays.ahead, rays.left
    far = 2.0 / np.hypot(1.0, rays.slope)
    points = np.stack(
        [far * (c * ahead - s * left), far * (s * ahead + c * left), 0.3 + far * rays.slope], -1
    )
    pixels = seen_by_opencv(points.reshape(-1, 3), LENS, mount)
    v, u = np.mgrid[0:480, 0:640]
    assert np.abs(pixels - np.column_stack([u.ravel(), v.ravel()])).max() < 1e-6


def test_a_lens_that_folds_the_picture_is_refused() -> None:
    with pytest.raises(ValueError, match="folds the picture"):
        pixel_rays(
            Intrinsics(640, 480, 300.0, 300.0, 319.5, 239.5, (-0.9, 0.0, 0.0, 0.0, 0.0)),
            CameraMount(0.0, 0.0, 0.3),
        )


def test_a_lens_whose_directions_are_not_found_is_refused() -> None:
    # Found by search: Newton's method goes round in a circle.
    distortion = (1.2822717858736796, 1.9037785697739391, 0.0, 0.0, -0.9705873900692614)
    with pytest.raises(ValueError, match="a pixel's direction is still wrong by"):
        pixel_rays(
            Intrinsics(61, 41, 30.0, 25.0, 30.0, 20.0, distortion), CameraMount(0.0, 0.0, 0.3)
        )


POSES = [(0.0, 0.0, 0.0), (-0.4, 0.3, 0.5), (0.2, -0.6, -0.35)]


@pytest.mark.parametrize("pose", POSES)
def test_a_walls_foot_is_where_opencv_projects_it(
    pose: tuple[float, float, float], tmp_path: Path
) -> None:
    world = room(tmp_path, "[[wall]]\npoints = [[2.0, -5.0], [2.4, 5.0]]\n" + BLACK)
    config = robot(CLEAN, LIT, {"simulation.camera.roll_error_deg": 3.0})
    camera = Camera(config, world)
    dark = camera.look(*pose).picture.max(axis=2) < 10
    foot = np.linspace([2.0, -5.0, 0.0], [2.4, 5.0, 0.0], 20_001)
    foot_base = to_base(foot, pose)
    pixels = seen_by_opencv(foot_base[foot_base[:, 0] > 0.4], camera.intrinsics, camera.mount)
    u, v = pixels[np.argsort(pixels[:, 0])].T
    columns = np.arange(640)
    expected = np.interp(columns, u, v)
    found = dark.sum(axis=0) - 0.5  # The boundary lies between the last dark row and the next.
    inside = (expected > 1) & (expected < 478) & (columns > u[0]) & (columns < u[-1])
    assert np.count_nonzero(inside) > 500
    assert np.abs(found - expected)[inside].max() <= 0.5 + 1e-3


def test_a_box_covers_the_pixels_within_its_outline_and_no_other(tmp_path: Path) -> None:
    world = room(
        tmp_path,
        "[[obstacle]]\ncentre = [1.1, 0.2]\nsize = [0.3, 0.2]\nheading_deg = 25.0\n"
        "height_m = 0.12\n" + BLACK,
    )
    pose = (0.05, -0.1, 0.1)
    camera = Camera(robot(CLEAN, LIT, SMALL, PINHOLE), world)
    dark = camera.look(*pose).picture.max(axis=2) < 10
    feet = world.things[0].corners
    corners = np.vstack([np.column_stack([feet, np.full(4, z)]) for z in (0.0, 0.12)])
    pixels = seen_by_opencv(to_base(corners, pose), camera.intrinsics, camera.mount)
    outline = cv2.convexHull(pixels.astype(np.float32))
    depth = np.array(
        [[cv2.pointPolygonTest(outline, (u, v), True) for u in range(160)] for v in range(120)]
    )
    assert np.count_nonzero(depth > 0) > 150
    clear = np.abs(depth) > 1e-2
    assert np.array_equal(dark[clear], depth[clear] > 0)


def brute_force(
    world: World, camera: Camera, pose: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Labels and level distances by trying each ray on each side and each top."""
    mount, lens = camera.mount, camera.intrinsics
    u, v = np.meshgrid(np.arange(lens.width_px), np.arange(lens.height_px))
    pixels = np.stack([u, v], -1).reshape(-1, 1, 2).astype(np.float64)
    matrix = np.array(
        [[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1]], dtype=float
    )
    undistorted = cv2.undistortPoints(
        pixels,
        matrix,
        np.array(lens.distortion),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12),
    )[:, 0]
    rays = np.column_stack([undistorted, np.ones(len(undistorted))]) @ rotation_base_camera(mount).T
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rays = rays @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    rays /= np.hypot(rays[:, 0], rays[:, 1])[:, None]
    eye = np.array(
        [pose[0] + c * mount.x_m - s * mount.y_m, pose[1] + s * mount.x_m + c * mount.y_m]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.where(rays[:, 2] < 0, -mount.z_m / rays[:, 2], np.inf)
        label = np.where(np.isfinite(best), -1, -2)
        for number, thing in enumerate(world.things):
            for ax, ay, bx, by in thing.sides():
                ex, ey = bx - ax, by - ay
                across = rays[:, 0] * ey - rays[:, 1] * ex
                t = ((ax - eye[0]) * ey - (ay - eye[1]) * ex) / across
                w = ((ax - eye[0]) * rays[:, 1] - (ay - eye[1]) * rays[:, 0]) / across
                z = mount.z_m + t * rays[:, 2]
                hit = (t > 0) & (w >= 0) & (w <= 1) & (z <= thing.height_m) & (z >= 0) & (t < best)
                best, label = np.where(hit, t, best), np.where(hit, number, label)
            if thing.solid and thing.height_m < mount.z_m:
                t = (thing.height_m - mount.z_m) / rays[:, 2]
                near = np.flatnonzero((t > 0) & (t < best))
                ring = thing.corners.astype(np.float32)
                for i in near:
                    point = eye + t[i] * rays[i, :2]
                    if cv2.pointPolygonTest(ring, (float(point[0]), float(point[1])), False) > 0:
                        best[i], label[i] = t[i], number
    shape = u.shape
    return label.reshape(shape), best.reshape(shape)


TELEPHOTO = {
    "camera.mount.pitch_deg": 0.0,
    "camera.intrinsics.fx_px": 2e4,
    "camera.intrinsics.fy_px": 2e4,
}
"""Fewer sectors than pixels of a full turn."""

CROWD = """
[[wall]]
points = [[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]]
closed = true
[[wall]]
points = [[2.5, -3.0], [2.5, 1.0], [3.5, 1.5]]
thickness_m = 0.12
[[wall]]
points = [[0.5, 1.5], [1.5, 1.2]]
height_m = 0.2
[[box]]
centre = [1.6, -0.6]
size = [0.5, 0.3]
heading_deg = 30.0
height_m = 0.25
[[box]]
centre = [1.9, -0.5]
size = [0.3, 0.3]
height_m = 0.4
[[furniture]]
kind = "pillar"
centre = [-1.5, 0.5]
radius_m = 0.3
height_m = 2.0
[[obstacle]]
centre = [1.0, 0.1]
radius_m = 0.06
height_m = 0.08
[[obstacle]]
centre = [1.2, 0.12]
size = [0.1, 0.1]
height_m = 0.28
[[obstacle]]
centre = [-0.8, -0.9]
size = [0.4, 0.05]
heading_deg = 70.0
height_m = 0.05
"""


@pytest.mark.parametrize(
    ("pose", "mount"),
    [
        ((0.0, 0.0, 0.0), {}),
        ((0.2, 0.4, 2.6), {"camera.mount.roll_deg": 10.0}),
        ((-0.3, 0.2, -1.9), {"camera.mount.yaw_deg": -60.0, "camera.mount.pitch_deg": 40.0}),
        ((1.05, 0.0, 0.3), {"camera.mount.pitch_deg": 85.0, "camera.mount.z_m": 0.6}),
        ((0.0, -0.3, 0.1), {"camera.mount.pitch_deg": 0.0, "camera.mount.z_m": 0.22}),
        ((0.0, -0.3, -0.024), {"camera.mount.roll_deg": 30.0, **TELEPHOTO}),
    ],
)
def test_each_pixel_shows_what_a_caster_that_tries_all_finds(
    pose: tuple[float, float, float], mount: dict[str, float], tmp_path: Path
) -> None:
    world = room(tmp_path, CROWD)
    camera = Camera(robot(CLEAN, SMALL, mount), world)
    view = camera.look(*pose)
    label, distance = brute_force(world, camera, pose)
    same = view.labels == label
    # On an edge a ray in single precision may pass on the other side.
    assert np.count_nonzero(~same) <= 8
    assert len(np.unique(label)) >= 2
    assert view.distances[same] == pytest.approx(distance[same], rel=1e-4)


def test_ranges_in_a_room_are_their_closed_form_and_start_below_the_camera() -> None:
    world = World.from_segments([(3, -4, 3, 4), (-2, -4, -2, 4)])
    mount = CameraMount(0.2, 0.1, 0.3, yaw_deg=30.0)
    angles = np.radians([-60.0, 0.0, 45.0, 180.0, 90.0])
    ranges = true_ranges(world, (1.0, 0.5, 0.0), mount, angles)
    assert ranges[:4] == pytest.approx([1.8 / 0.5, 1.8, 1.8 * math.sqrt(2), 3.2])
    assert ranges[4] == math.inf


def test_the_true_ranges_are_the_distances_of_the_pixels_on_what_is_tall() -> None:
    world = load_world(CONFIGS / "worlds" / "clutter.toml")
    camera = Camera(robot(CLEAN), world)
    pose = (0.8, 2.5, 0.1)
    view = camera.look(*pose)
    rays = pixel_rays(camera.intrinsics, camera.mount)
    tall = np.array([thing.height_m > camera.mount.z_m for thing in world.things])
    shown = (view.labels >= 0) & tall[view.labels]
    shown[::2] = shown[:, ::3] = False
    angles = np.arctan2(rays.left[shown], rays.ahead[shown])
    truth, seen = true_ranges(world, pose, camera.mount, angles), view.distances[shown]
    same = np.abs(seen / truth - 1.0) < 1e-5
    assert np.mean(same) > 0.7
    # The others look over something that is no wall.
    assert np.all(seen[~same] > truth[~same])
    low = World.from_segments(
        np.vstack([thing.sides() for thing in world.things if thing.kind != "wall"])
    )
    nearer = true_ranges(low, pose, camera.mount, angles[~same])
    assert nearer == pytest.approx(truth[~same])


def test_what_is_said_to_be_in_the_picture_is_in_it() -> None:
    world = load_world(CONFIGS / "worlds" / "clutter.toml")
    camera = Camera(robot(CLEAN), world)
    names = [thing.name for thing in world.things]
    checked = 0
    for pose in [(0.8, 2.5, 0.0), (1.2, 1.4, 0.6), (4.8, 2.4, 2.9), (3.0, 2.2, -1.2)]:
        view = camera.look(*pose)
        shown = {names[label] for label in np.unique(view.labels) if label >= 0}
        said = {each.name: each for each in sightings(world, pose, camera.intrinsics, camera.mount)}
        for name, each in said.items():
            assert name in shown
            middle = seen_by_opencv(
                np.array([[each.near_x_m, each.near_y_m, 0.002]]), camera.intrinsics, camera.mount
            )[0]
            if each.seen == 1.0 and each.kind == "obstacle" and middle[1] < 470:
                u, v = np.rint(middle).astype(int)
                around = view.labels[v - 2 : v + 3, u - 2 : u + 3]
                assert names.index(name) in around
                checked += 1
        # A thing whose top alone shows has no foot in the picture; others are all named.
        feet = view.labels[2:] != view.labels[:-2]
        for name in shown - set(said):
            below = (view.labels[:-2] == names.index(name)) & feet & (view.labels[2:] == -1)
            assert name == "outer" or np.count_nonzero(below) <= 4
    assert checked >= 6


def test_a_camera_that_looks_backward_has_the_truth_of_one_that_looks_ahead() -> None:
    world = load_world(CONFIGS / "worlds" / "clutter.toml")
    ahead = CameraMount(0.12, 0.03, 0.3, yaw_deg=0.0, pitch_deg=25.0)
    backward = CameraMount(-0.12, -0.03, 0.3, yaw_deg=180.0, pitch_deg=25.0)
    checked = 0
    for x, y, theta in [(0.8, 2.5, 0.0), (1.2, 1.4, 0.6), (4.8, 2.4, 2.9), (3.0, 2.2, -1.2)]:
        seen = sightings(world, (x, y, theta), LENS, ahead)
        turned = sightings(world, (x, y, theta + math.pi), LENS, backward)
        assert [each.name for each in turned] == [each.name for each in seen]
        for one, other in zip(seen, turned, strict=True):
            for what in ("x_m", "y_m", "near_x_m", "near_y_m", "front_x_m", "front_y_m"):
                assert getattr(other, what) == pytest.approx(-getattr(one, what), abs=1e-9), what
            assert (other.height_m, other.seen) == (one.height_m, one.seen)
            checked += 1
    assert checked >= 10


def test_the_front_of_a_foot_is_where_a_ray_halfway_between_its_ends_meets_it(
    tmp_path: Path,
) -> None:
    world = room(tmp_path, "[[box]]\ncentre = [-2.0, 0.0]\nsize = [1.0, 1.0]\nheight_m = 0.2\n")
    mount = CameraMount(0.0, 0.0, 0.3, yaw_deg=180.0, pitch_deg=15.0)
    (seen,) = sightings(world, (0.0, 0.0, 0.0), LENS, mount)
    assert (seen.front_x_m, seen.front_y_m) == pytest.approx((-1.5, 0.0))


@pytest.mark.parametrize(("heading_deg", "near_m"), [(0.0, 1.5), (45.0, 2.0 - math.sqrt(0.5))])
def test_the_nearest_point_of_a_foot_may_be_a_corner(
    heading_deg: float, near_m: float, tmp_path: Path
) -> None:
    box = "[[box]]\ncentre = [2.1, 0.0]\nsize = [1.0, 1.0]\nheight_m = 0.2\n"
    world = room(tmp_path, box + f"heading_deg = {heading_deg}\n")
    (seen,) = sightings(world, (0.0, 0.0, 0.0), LENS, CameraMount(0.1, 0.0, 0.3, pitch_deg=15.0))
    assert (seen.near_x_m, seen.near_y_m) == pytest.approx((0.1 + near_m, 0.0), abs=1e-9)


def test_a_lens_that_cannot_be_is_refused_by_the_robots_name() -> None:
    world = load_world(CONFIGS / "worlds" / "clutter.toml")
    folded = {"camera.intrinsics.distortion": [-0.9, 0.0, 0.0, 0.0, 0.0]}
    with pytest.raises(SimulationError, match="diff_drive: camera: distortion: folds the picture"):
        Camera(robot(folded), world)
