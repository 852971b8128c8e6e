"""From pictures to messages and back to scans."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest

from firmware_sim.camera.camera import Camera
from firmware_sim.camera.truth import sightings
from firmware_sim.config.config import load_robot as load_simulated_robot
from firmware_sim.world.world import load_world
from robotctl.app.processes.floor_pipeline import GroundWatch
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.places.visual.features import features_in
from robotctl.estimation.places.visual.orb import features_of
from robotctl.estimation.ranging.scan_messages import camera_scan
from robotctl.messages.control import SafetyState
from robotctl.messages.estimation import CameraView
from tests.messages.test_world_pose import STATE


@pytest.fixture(scope="module")
def config():
    return load_robot(find_file("diff_drive"), ("camera.enabled=true",))


@pytest.fixture(scope="module")
def watch(config):
    return GroundWatch(config.camera, config.ground_camera)


def picture(config, horizon_row=None, seed=0):
    """A grey floor of noise under a red wall."""
    lens = config.camera.intrinsics
    rng = np.random.default_rng(seed)
    image = rng.integers(110, 130, (lens.height_px, lens.width_px, 3), dtype=np.uint8)
    if horizon_row is not None:
        image[:horizon_row] = (40, 40, 200)
    return image


COMPILED_LATE = """
import sys
import numpy as np
from numba.core.registry import CPUDispatcher
from native_kernels import library

library.native_library = lambda _: None  # as where there is no library of all kernels
from robotctl.app.processes import floor_pipeline as ground_watch
from robotctl.config.robot_file import find_file, load_robot

def compiled():
    return {
        f"{name}.{key}": len(value.signatures)
        for name, module in sys.modules.items()
        if name.startswith("robotctl.estimation.camera")
        for key, value in vars(module).items()
        if isinstance(value, CPUDispatcher)
    }

if sys.argv[1] == "without":
    ground_watch._rehearse = lambda: None
config = load_robot(find_file("diff_drive"))
watch = ground_watch.GroundWatch(config.camera, config.ground_camera)
before = compiled()
picture = np.random.default_rng(1).integers(110, 130, (480, 640, 3), dtype=np.uint8)
picture[:100] = (90, 30, 30)
picture[150:250, 250:350] = (30, 30, 200)
view = watch.look(picture, 0)
assert view.trouble == "" and len(view.obstacles) == 1, view
print(*sorted(key for key, number in compiled().items() if number > before[key]))
"""


def compiled_by_a_picture(rehearsal: str) -> set[str]:
    """Names of the kernels that a process has to compile when its first picture has come."""
    run = subprocess.run(
        [sys.executable, "-c", COMPILED_LATE, rehearsal],
        check=True,
        capture_output=True,
        text=True,
    )
    return {name.rpartition(".")[2] for name in run.stdout.split()}


def test_nothing_is_compiled_when_the_first_picture_comes():
    assert compiled_by_a_picture("with") == set()
    # So many would be; other kernels call the rest.
    assert {"_evidence", "_first_cells", "_refine", "_beams", "_goes_on_behind"} <= (
        compiled_by_a_picture("without")
    )


def test_a_view_survives_the_way_to_another_process(config, watch):
    seen = watch.look(picture(config, 200), 17)
    again = msgspec.msgpack.decode(msgspec.msgpack.encode(seen), type=CameraView)
    scan = camera_scan(again)
    assert again.trouble == ""
    assert scan.stamp_ns == 17
    assert len(scan.ranges_m) == config.ground_camera.beams
    assert scan.x_m == pytest.approx(config.camera.mount.x_m)
    measured = np.isfinite(scan.ranges_m)
    assert measured.mean() > 0.7
    assert np.all(scan.sigmas_m[measured] > 0.0)


def test_a_wall_nearer_in_the_picture_is_nearer_in_metres(config, watch):
    far, near = (
        np.nanmedian(camera_scan(watch.look(picture(config, row), 0)).ranges_m)
        for row in (200, 300)
    )
    assert near < 0.7 * far


def test_the_floor_is_learnt_anew_when_the_robot_is_armed(config):
    eye = GroundWatch(config.camera, config.ground_camera)
    blue = picture(config, 200)
    blue[200:] = (np.int16(blue[200:]) * (1.6, 1.0, 0.5)).clip(0, 255).astype(np.uint8)
    assert eye.look(picture(config, 200), 0).trouble == ""
    assert "does not look like the floor" in eye.look(blue, 1).trouble
    eye.attend(msgspec.structs.replace(STATE, state=SafetyState.STANDBY))
    assert eye.look(blue, 2).trouble != ""
    eye.attend(msgspec.structs.replace(STATE, state=SafetyState.ARMED, armings=1))
    assert eye.look(blue, 3).trouble == ""
    driving = msgspec.structs.replace(STATE, state=SafetyState.DRIVING, armings=1)
    eye.attend(driving)
    assert eye.look(picture(config, 200), 4).trouble != ""
    eye.attend(msgspec.structs.replace(driving, armings=2))  # a stop between shows in no state
    assert eye.look(picture(config, 200), 5).trouble == ""


def test_features_come_along_four_times_a_second_where_places_are_recognised(config, watch):
    eye = GroundWatch(config.camera, config.ground_camera, with_features=True)
    lens, rng = config.camera.intrinsics, np.random.default_rng(4)
    image = rng.integers(0, 255, (lens.height_px, lens.width_px, 3), dtype=np.uint8)
    views = [eye.look(image, stamp_ms * 1_000_000) for stamp_ms in range(0, 1000, 50)]
    with_them = [view.stamp_ns // 1_000_000 for view in views if view.features is not None]
    assert with_them == [0, 250, 500, 750]
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    alone = features_of(grey)
    assert len(alone) > 100
    assert features_in(views[0].features).descriptors.tolist() == alone.descriptors.tolist()
    np.testing.assert_allclose(features_in(views[0].features).points, alone.points, atol=1e-6)
    assert watch.look(image, 0).features is None


def test_a_picture_of_another_size_is_not_judged_and_says_so(watch):
    seen = watch.look(np.zeros((10, 20, 3), np.uint8), 5)
    assert seen.trouble == "a picture of 20 x 10 px, not as calibrated"
    assert seen.stamp_ns == 5
    assert seen.ranges_m == ()


def test_a_camera_that_sees_no_floor_is_refused_with_its_table(config):
    skywards = replace(config.camera, mount=replace(config.camera.mount, pitch_deg=-80.0))
    with pytest.raises(ConfigError, match="camera: "):
        GroundWatch(skywards, config.ground_camera)


@pytest.mark.parametrize(
    ("pose", "thing"),
    [
        ((2.91, 3.57, -3.12), "toy block"),  # yellow on brown wood, in dimmer light than the patch
        ((2.10, 3.57, 3.13), "toy block"),
        ((1.50, 1.30, 0.20), "shoe"),
    ],
)
def test_small_things_of_the_cluttered_room_are_seen_where_they_lie(config, pose, thing):
    robot, world = find_file("diff_drive"), find_file("clutter", "worlds")
    camera = Camera(load_simulated_robot(robot), load_world(world), seed=3)
    frame = camera.look(*pose, 0).framed(0, 0)
    image = np.frombuffer(frame.pixels, np.uint8).reshape(frame.height, frame.width, 3)
    eye = GroundWatch(config.camera, config.ground_camera)
    seen = eye.look(image, 0)
    assert seen.trouble == ""
    true = {
        each.name: each
        for each in sightings(load_world(world), pose, camera.intrinsics, camera.mount)
    }[thing]
    offsets = [
        math.hypot(each.x_m - true.near_x_m, each.y_m - true.near_y_m) for each in seen.obstacles
    ]
    assert min(offsets, default=math.inf) < 0.15
