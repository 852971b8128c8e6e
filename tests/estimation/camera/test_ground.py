"""Pictures of known scenes through the whole of the ground camera, by an independent renderer."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.ground import GroundCamera, GroundView
from robotctl.model.sensors.camera import CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry
from tests.estimation.camera.camera_pictures import (
    CAMERA,
    LENS,
    Block,
    Scene,
    even,
    planks,
    room,
    speckled,
    tiled,
)

FLOORS = {"speckled": speckled(), "tiled": tiled(), "planks": planks(), "even": even()}
THINGS = (
    Block(1.0, 0.15, 0.08, 0.08, 0.08, (0.15, 0.2, 0.6)),
    Block(1.4, -0.35, 0.15, 0.1, 0.2, (0.1, 0.5, 0.15), 0.5),
)
WALL = (0.75, 0.6, 0.5)
CONFIG = GroundCameraConfig()


@functools.cache
def picture(floor: str = "speckled", things: bool = True, **changes: float) -> np.ndarray:
    scene = Scene(THINGS if things else (), FLOORS[floor], room(2.6, WALL), **changes)
    return scene.picture(CAMERA)


def truth(view: GroundView, things: bool = True) -> np.ndarray:
    scene = Scene(THINGS if things else (), walls=room(2.6, WALL))
    return scene.ranges(view.scan.x_m, view.scan.y_m, view.scan.angles_rad)


@pytest.fixture(scope="module")
def fresh() -> GroundCamera:
    return GroundCamera(CAMERA, CONFIG)


def first_look(camera: GroundCamera, image: np.ndarray) -> GroundView:
    camera.reset()
    return camera.step(image, 1)


@pytest.mark.parametrize("floor", list(FLOORS))
def test_ranges_are_true_within_their_sigmas_on_any_floor(floor: str, fresh: GroundCamera) -> None:
    view = first_look(fresh, picture(floor))
    assert view.trusted
    scan, expected = view.scan, truth(view)
    measured = np.isfinite(scan.ranges_m) & (expected < 3.0)
    assert measured.sum() > 40
    error = np.abs(scan.ranges_m - expected)[measured]
    # The pictures have half of the usual size.
    assert np.median(error / expected[measured]) < 0.03
    assert np.mean(error <= 3.0 * scan.sigmas_m[measured]) > 0.9
    # Nothing that stands there is called free.
    assert not np.any(np.isinf(scan.ranges_m[expected < 3.0]))


@pytest.mark.parametrize("floor", list(FLOORS))
def test_things_are_found_on_their_floor_and_their_shadows_are_not(
    floor: str, fresh: GroundCamera
) -> None:
    found = first_look(fresh, picture(floor)).obstacles
    assert len(found) == 2
    for thing, obstacle in zip(THINGS, sorted(found, key=lambda o: o.foot_base[0]), strict=True):
        error = obstacle.centre_base - [thing.x, thing.y]
        assert np.hypot(*error) < 0.05
        assert error @ np.linalg.solve(obstacle.centre_covariance, error) < 11.83
        # With a wall behind its upper edge there is no telling.
        assert obstacle.height_m > 0.7 * thing.height
        assert obstacle.height_m < 1.5 * thing.height or math.isinf(obstacle.height_m)


@pytest.mark.parametrize("floor", ["tiled", "planks"])
def test_an_empty_floor_has_no_things(floor: str, fresh: GroundCamera) -> None:
    assert first_look(fresh, picture(floor, False)).obstacles == ()


@pytest.mark.parametrize("changes", [{"brightness": 0.25}, {"noise": 6.0}, {"direct": 0.85}])
def test_dim_light_noise_and_hard_shadows_do_little_harm(
    changes: dict[str, float], fresh: GroundCamera
) -> None:
    view = first_look(fresh, picture("speckled", True, **changes))
    assert view.trusted
    assert len(view.obstacles) == 2
    expected = truth(view)
    measured = np.isfinite(view.scan.ranges_m) & (expected < 3.0)
    error = np.abs(view.scan.ranges_m - expected)[measured] / expected[measured]
    assert np.median(error) < 0.02


def test_the_same_picture_says_the_same() -> None:
    views = [first_look(GroundCamera(CAMERA, CONFIG), picture()) for _ in range(2)]
    assert np.array_equal(views[0].scan.ranges_m, views[1].scan.ranges_m, equal_nan=True)
    assert len(views[0].obstacles) == len(views[1].obstacles)


def test_a_thing_right_in_front_is_seen_on_a_floor_that_is_known(fresh: GroundCamera) -> None:
    box = Block(0.72, 0.0, 0.2, 0.5, 0.4, (0.1, 0.15, 0.6))
    blocked = Scene((box,), FLOORS["speckled"], room(2.6, WALL), direct=0.3).picture(CAMERA)
    first_look(fresh, picture("speckled", False))
    view = fresh.step(blocked, 2)
    ahead = np.abs(view.scan.angles_rad) < 0.2
    assert np.all(view.scan.ranges_m[ahead] < 0.62)
    # Looking at it for long does not make it floor.
    for k in range(40):
        view = fresh.step(blocked, 3 + k)
    assert np.all(view.scan.ranges_m[ahead] < 0.62)


def test_a_patch_that_is_all_wall_is_not_learned(fresh: GroundCamera) -> None:
    wall = Scene((), FLOORS["speckled"], (Block(0.35, 0.0, 0.1, 4.0, 2.0, (0.5, 0.6, 0.7)),))
    view = first_look(fresh, wall.picture(CAMERA))
    assert not view.trusted
    assert view.why
    assert view.obstacles == ()
    assert not np.any(np.isinf(view.scan.ranges_m))
    # As soon as there is floor in sight, that is learned.
    assert fresh.step(picture("speckled", False), 2).trusted


def test_a_wall_of_the_colour_of_most_of_the_floor_is_not_learned() -> None:
    # All of a picture is learned: the wall once, and the rest of the floor would be forgotten.
    camera = GroundCamera(CAMERA, replace(CONFIG, adaption=1.0))
    grey, brown = (0.35, 0.4, 0.45), (0.2, 0.3, 0.45)

    def striped(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Each fifth board is brown."""
        return np.where((np.floor(y / 0.06) % 5 == 0)[..., None], brown, speckled(grey)(x, y))

    free = Scene((), striped, room(2.6, WALL)).picture(CAMERA)
    wall = Scene((), striped, (Block(0.35, 0.0, 0.1, 4.0, 2.0, grey),), texture=0.2)
    near = wall.picture(CAMERA)
    first = camera.step(free, 0)
    for k in range(9):
        view = camera.step(near, 1 + k)
        assert "above the horizon looks like the floor" in view.why
        assert np.all(np.isnan(view.scan.ranges_m))
    again = camera.step(free, 10)
    assert again.trusted
    assert np.array_equal(again.scan.ranges_m, first.scan.ranges_m, equal_nan=True)


@pytest.mark.parametrize(("level", "message"), [(0, "too dark"), (255, "overexposed")])
def test_a_picture_that_shows_nothing_is_not_trusted(
    level: int, message: str, fresh: GroundCamera
) -> None:
    view = first_look(fresh, np.full((240, 320, 3), level, np.uint8))
    assert not view.trusted
    assert message in view.why
    assert np.all(np.isnan(view.scan.ranges_m))


def test_another_floor_is_not_taken_for_the_known_one(fresh: GroundCamera) -> None:
    first_look(fresh, picture("planks", False))
    view = fresh.step(picture("tiled", False), 2)
    assert not view.trusted
    assert "does not look like the floor" in view.why
    # It errs to the near side: the beams ahead end at once.
    ahead = np.abs(view.scan.angles_rad) < 0.2
    assert np.nanmax(view.scan.ranges_m[ahead]) < 0.5


def test_another_exposure_of_the_same_view_is_followed(fresh: GroundCamera) -> None:
    first_look(fresh, picture("speckled"))
    view = fresh.step(picture("speckled", True, brightness=0.35), 2)
    assert view.trusted
    assert len(view.obstacles) == 2


def test_a_camera_that_leans_and_looks_aside_measures_as_well() -> None:
    mount = CameraMount(0.0, 0.1, 0.45, 20.0, 30.0, 4.0)
    camera = CameraGeometry(LENS, mount)
    scene = Scene((Block(1.2, 0.55, 0.1, 0.1, 0.1, (0.15, 0.2, 0.6)),), tiled(), room(2.2, WALL))
    view = GroundCamera(camera, CONFIG).step(scene.picture(camera), 1)
    expected = scene.ranges(view.scan.x_m, view.scan.y_m, view.scan.angles_rad)
    measured = np.isfinite(view.scan.ranges_m) & (expected < 3.0)
    error = np.abs(view.scan.ranges_m - expected)[measured] / expected[measured]
    assert measured.sum() > 30
    assert np.median(error) < 0.02
    (found,) = view.obstacles
    assert found.centre_base == pytest.approx([1.2, 0.55], abs=0.05)


def test_a_camera_that_sees_no_horizon_works_up_to_where_it_sees() -> None:
    mount = CameraMount(0.1, 0.0, 0.4, 0.0, 50.0, 0.0)
    camera = CameraGeometry(LENS, mount)
    scene = Scene((Block(0.6, 0.05, 0.06, 0.06, 0.06, (0.15, 0.2, 0.6)),), speckled())
    view = GroundCamera(camera, CONFIG).step(scene.picture(camera), 1)
    (found,) = view.obstacles
    assert found.foot_base == pytest.approx([0.57, 0.05], abs=0.02)
    assert not np.any(np.isinf(view.scan.ranges_m))


def test_a_wall_of_the_floors_colour_is_never_called_free() -> None:
    # No horizon in sight, so the wall tells nothing about itself.
    camera = CameraGeometry(LENS, CameraMount(0.0, 0.1, 0.45, 20.0, 30.0, 4.0))
    scene = Scene((), tiled(), room(2.2))
    view = GroundCamera(camera, CONFIG).step(scene.picture(camera), 1)
    expected = scene.ranges(view.scan.x_m, view.scan.y_m, view.scan.angles_rad)
    assert not np.any(np.isinf(view.scan.ranges_m[expected < 3.0]))


def test_settings_that_cannot_be_are_refused() -> None:
    for key, value in (("adaption", 0.0), ("beams", 0), ("max_range_m", math.nan)):
        with pytest.raises(ValueError, match=key):
            GroundCameraConfig(**{key: value})  # type: ignore[arg-type]
