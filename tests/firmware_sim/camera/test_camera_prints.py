"""What tells places apart in the simulated camera's pictures: prints on walls, an uneven floor."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from firmware_sim.camera.camera import Camera
from firmware_sim.camera.floor import PERIOD_M, SIDE, print_texture
from firmware_sim.camera.prints import PRINT, SLOT_M, side_slots
from firmware_sim.camera.scene import make_scene
from firmware_sim.world.world import load_world
from robotctl.config.robot_file import find_file
from robotctl.estimation.places.visual.orb import features_of
from robotctl.estimation.places.visual.recognition import VisualPlaces, sight_of
from robotctl.maps.vocabulary_file import load_vocabulary, shipped_vocabulary
from tests.firmware_sim.camera.camera_rig import (
    CLEAN,
    PINHOLE,
    robot,
    room,
    seen_by_opencv,
    to_base,
)

WALL_X_M = 2.0
WALL = f"[[wall]]\npoints = [[{WALL_X_M}, -3.0], [{WALL_X_M}, 3.0]]\n"
OFFICE = load_world(find_file("office", "worlds"))


def pattern(slot: np.void, along_m: np.ndarray, up_m: np.ndarray) -> np.ndarray:
    """Brightness of a print at points of its side, by scipy."""
    packed = print_texture(0).texels[: SIDE * SIDE].reshape(SIDE, SIDE)
    at = [(up_m + slot["y"]) / PERIOD_M * SIDE - 0.5, (along_m + slot["x"]) / PERIOD_M * SIDE - 0.5]
    first, second, third = (
        map_coordinates(((packed >> bits) & 255).astype(float), at, order=1, mode="grid-wrap")
        for bits in (0, 8, 16)
    )
    return slot["first"] * first + slot["second"] * second + slot["third"] * third


def depth(corners: np.ndarray) -> np.ndarray:
    """How far each pixel is inside of a convex outline, (480, 640) [px]; < 0: outside."""
    v, u = np.mgrid[0:480, 0:640]
    sides = []
    for (u0, v0), (u1, v1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        sides.append(((u1 - u0) * (v - v0) - (v1 - v0) * (u - u0)) / math.hypot(u1 - u0, v1 - v0))
    turn = 1.0 if sides[0][tuple(corners.mean(axis=0).astype(int)[::-1])] > 0.0 else -1.0
    return np.min(turn * np.array(sides), axis=0)


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (0.1, 0.6, -0.3)])
def test_prints_hang_where_opencv_projects_them_and_show_their_window(pose, tmp_path):
    world = room(tmp_path, WALL)
    slots = make_scene(world).prints.slots
    camera = Camera(robot(CLEAN, PINHOLE, {"camera.mount.pitch_deg": 0.0}), world)
    view = camera.look(*pose)
    picture = view.picture.astype(float)
    inside = np.full((480, 640), -np.inf)
    shown = 0
    for slot in slots[slots["right"] > 0.0]:
        across, up = (
            np.linspace(slot["left"], slot["right"], 60),
            np.linspace(slot["low"], slot["high"], 60),
        )
        points = np.array([(WALL_X_M, a - 3.0, z) for z in up for a in across])
        u, v = seen_by_opencv(to_base(points, pose), camera.intrinsics, camera.mount).T
        outline = np.column_stack([u, v])[[0, 59, -1, -60]]
        if not (np.all(outline > 1.0) and np.all(outline < (638.0, 478.0))):
            continue
        shown += 1
        inside = np.maximum(inside, depth(outline))
        grey = map_coordinates(picture.max(axis=2), [v, u], order=1)
        along_m, up_m = points[:, 1] + 3.0, points[:, 2]
        right = np.corrcoef(grey, pattern(slot, along_m, up_m))[0, 1]
        assert right > 0.8
        for move_m in ((0.02, 0.0), (0.0, 0.02)):
            moved = pattern(slot, along_m + move_m[0], up_m + move_m[1])
            assert right > np.corrcoef(grey, moved)[0, 1] + 0.05
    assert shown >= 2
    coloured = picture.max(axis=2) - picture.min(axis=2) > 0.3 * picture.max(axis=2)
    # Within their outlines and 20 px around; further off may be one that is cut.
    clear = (view.labels == 0) & (np.abs(inside) > 0.02) & (inside > -20.0)
    assert np.array_equal(coloured[clear], inside[clear] > 0.0)


def test_prints_stay_on_their_side_and_leave_the_foot_plain():
    rng = np.random.default_rng(4)
    for length_m in (0.3, 0.5, 1.7, 6.0):
        slots = np.concatenate([side_slots(length_m, 2.5, rng) for _ in range(20)])
        assert len(slots) == 20 * max(1, int(length_m / SLOT_M))
        shown = slots[slots["right"] > 0.0]
        assert 0.3 * len(slots) < len(shown) < 0.9 * len(slots)
        assert shown["left"].min() > 0.0
        assert shown["right"].max() < length_m
        assert np.all(shown["right"] - shown["left"] > 0.15)
        assert shown["low"].min() >= 0.4
    assert len(side_slots(0.2, 2.5, rng)) == 0
    low = side_slots(6.0, 0.2, rng)
    assert np.all(low["high"] <= low["low"])


def test_what_has_a_colour_of_its_own_and_what_lies_about_is_bare(tmp_path):
    box = "[[box]]\ncentre = [2.0, 0.0]\nsize = [1.0, 1.0]\n"
    lying = "[[obstacle]]\ncentre = [0.0, 2.0]\nsize = [1.0, 1.0]\nheight_m = 1.0\n"
    assert len(make_scene(room(tmp_path, box)).prints.slots) == 4 + 1
    assert len(make_scene(room(tmp_path, box + 'colour = "#808080"\n')).prints.slots) == 1
    assert len(make_scene(room(tmp_path, lying)).prints.slots) == 1


def test_no_two_prints_of_a_building_look_alike():
    slots = make_scene(OFFICE).prints.slots
    slots = slots[slots["right"] > 0.0]
    assert len(slots) > 100
    up_m, along_m = np.mgrid[0:0.25:20j, 0:0.2:16j]
    looks = []
    for slot in slots:
        look = pattern(slot, along_m + slot["left"], up_m + slot["low"]).ravel()
        looks.append((look - look.mean()) / look.std())
    alike = np.abs(np.array(looks) @ np.array(looks).T / up_m.size)
    alike = alike[np.triu_indices(len(slots), 1)]
    assert np.mean(alike > 0.5) < 0.005
    assert alike.max() < 0.95


@pytest.mark.parametrize("name", ["tiles", "wood", "carpet", "concrete"])
def test_the_floor_one_period_on_is_another(name, tmp_path):
    world = room(tmp_path, f'[floor]\ntexture = "{name}"\n')
    even = {"simulation.camera.ambient": 1.0}
    camera = Camera(robot(CLEAN, even, {"camera.mount.pitch_deg": 90.0}), world)

    def look(x_m: float, y_m: float) -> np.ndarray:
        return camera.look(x_m, y_m, 0.3).picture.astype(float)

    for x_m, y_m in ((PERIOD_M, 0.0), (0.0, PERIOD_M), (2 * PERIOD_M, -PERIOD_M)):
        differences = [
            np.mean(np.abs(look(0.3 * k, 0.1 * k) - look(0.3 * k + x_m, 0.1 * k + y_m)))
            for k in range(5)
        ]
        assert np.mean(differences) > 4.0


def test_a_second_way_down_the_corridor_is_recognised_at_the_right_places():
    camera = Camera(robot(), OFFICE, seed=1)
    vocabulary = load_vocabulary(shipped_vocabulary())
    places = VisualPlaces(vocabulary)
    rng = np.random.default_rng(2)
    at_m = np.arange(1.5, 15.0, 0.45)
    found = []
    for number, x_m in enumerate(np.concatenate([at_m, at_m + 0.1])):
        y_m, theta = 7.5 + rng.normal(0.0, 0.05), rng.normal(0.0, math.radians(2.0))
        picture = camera.look(x_m, y_m, theta, number=number).picture
        features = features_of(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
        sight = sight_of(vocabulary, features)
        found.append(places.suggest(sight, is_next=True).found)
        places.add(sight)
    pairs = [(i, each.place) for i, each in enumerate(found) if each is not None]
    assert all(i >= len(at_m) and abs(i - len(at_m) - image) <= 3 for i, image in pairs)
    assert len(pairs) > 0.5 * len(at_m)


def test_the_prints_of_a_world_are_those_of_its_seed():
    first, second = make_scene(OFFICE).prints.slots, make_scene(OFFICE).prints.slots
    assert first.dtype == PRINT
    assert np.array_equal(first, second)
