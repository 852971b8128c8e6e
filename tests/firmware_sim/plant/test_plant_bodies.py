"""Robots with arms, jaws and parts beside them, against walls and people, with shapely's eyes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from firmware_sim.config.config import RobotConfig, load_robot
from firmware_sim.config.outline import pieces_of
from firmware_sim.errors import SimulationError
from firmware_sim.plant.discs import nearest_point
from firmware_sim.plant.plant import Plant
from firmware_sim.plant.walls import body_outline
from firmware_sim.world.world import World, load_world
from tests.firmware_sim.plant.plants import command
from tests.model.polygon_bodies import bodies, shape_of

CONFIGS = Path(__file__).parents[3] / "configs"
FLAT = load_world(CONFIGS / "worlds" / "flat.toml")
WITH_ARM = (
    (0.185, -0.45), (0.185, 0.165), (-0.16, 0.165), (-0.16, -0.165), (0.1, -0.165), (0.1, -0.45),
)  # fmt: skip
MIRRORED = tuple((x, -y) for x, y in WITH_ARM)


def robot(body: object, **parts: object) -> RobotConfig:
    tables = [{"name": name, "outline": outline} for name, outline in parts.items()]
    return load_robot(CONFIGS / "diff_drive.toml", {"simulation.body": body, "body.part": tables})


def plant(config: RobotConfig, world: World) -> Plant:
    return Plant(config, world, np.random.default_rng(1))


def floor_of(config: RobotConfig, p: Plant) -> shapely.Geometry:
    """Return what the robot covers of the floor, in world."""
    shape = shapely.union_all([shapely.Polygon(each) for each in config.outlines[0]])
    shape = shapely.affinity.rotate(shape, p.theta_rad, origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(shape, p.x_m, p.y_m)


@given(bodies())
def test_convex_pieces_cover_the_same_floor(body):
    for corners in body.outlines:
        for way_round in (corners, corners[::-1]):
            pieces = [shapely.Polygon(each) for each in pieces_of(way_round)]
            assert all(piece.exterior.is_ccw for piece in pieces)
            assert sum(piece.area for piece in pieces) == pytest.approx(
                shapely.Polygon(corners).area
            )
            whole = shapely.union_all([piece.buffer(1e-9) for piece in pieces])
            assert whole.symmetric_difference(shapely.Polygon(corners)).area < 1e-6


@given(bodies(), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_the_nearest_point_of_a_body_is_the_one_that_shapely_finds(body, x, y):
    shape, point = shape_of(body), shapely.Point(x, y)
    assume(shape.boundary.distance(point) > 1e-6)
    outline = body_outline([piece for each in body.outlines for piece in pieces_of(each)])
    distance, near_x, near_y = nearest_point(x, y, outline)
    assert (distance < 0.0) == shape.contains(point)
    if distance > 0.0:
        assert distance == pytest.approx(shape.distance(point))
        assert math.dist((near_x, near_y), (x, y)) == pytest.approx(distance)
        assert shape.distance(shapely.Point(near_x, near_y)) < 1e-9


@given(st.floats(0.5, 5.5), st.floats(0.5, 4.5), st.floats(-math.pi, math.pi))
def test_it_can_be_placed_where_no_wall_is_in_the_body(x, y, theta):
    config = robot(WITH_ARM)
    walls = World.from_segments([(2.0, 1.0, 4.0, 1.0), (3.0, 2.0, 3.4, 2.9), (1.0, 3.0, 1.0, 4.5)])
    p = plant(config, walls)
    lines = [shapely.LineString([each[:2], each[2:]]) for each in walls.segments]
    shape = shapely.Polygon(WITH_ARM)
    shape = shapely.affinity.rotate(shape, theta, origin=(0.0, 0.0), use_radians=True)
    shape = shapely.affinity.translate(shape, x, y)
    apart = min(shape.distance(line) for line in lines)
    deep = max(shape.intersection(line).length for line in lines)
    if apart > 1e-6:
        p.place(x, y, theta)
    elif deep > 1e-6:
        with pytest.raises(SimulationError, match="a wall is in the way"):
            p.place(x, y, theta)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([WITH_ARM, MIRRORED]))
def test_an_arm_never_gets_through_a_wall(seed, body):
    config = robot(body, handle=((-0.3, -0.05), (-0.1, -0.05), (-0.1, 0.05), (-0.3, 0.05)))
    p = plant(config, FLAT)
    rng = np.random.default_rng(seed)
    walls = shapely.MultiLineString([(each[:2], each[2:]) for each in FLAT.segments.tolist()])
    touched = False
    for _ in range(25):
        left, right = rng.uniform(-0.4, 1.0) + rng.uniform(-0.3, 0.3, 2)
        command(p, *np.clip([left, right], -1.0, 1.0), 0.0)
        p.step(int(rng.integers(100, 600)))
        floor = floor_of(config, p)
        touched |= p.touching
        assert not floor.buffer(-2e-3).intersects(walls)
        if floor.distance(walls) > 0.05:
            assert int(p._b["contacts"]) == 0


def test_a_wall_may_reach_in_between_arm_and_body() -> None:
    stub = World.from_segments([(-0.6, -0.3, 0.4, -0.3)])
    for body, touches in ((WITH_ARM, True), (MIRRORED, False)):
        p = plant(robot(body), World.from_segments([(-0.6, -0.3, 0.05, -0.3)]))
        command(p, -0.3, -0.3)
        p.step(3000)
        assert (p.collisions > 0) == touches
    p = plant(robot(MIRRORED), stub)
    command(p, 0.3, 0.3)
    p.step(1000)
    assert p.collisions == 0
    with pytest.raises(SimulationError, match="a wall is in the way"):
        plant(robot(WITH_ARM), stub)


def test_a_part_beside_the_outline_is_driven_against_walls() -> None:
    wall = World.from_segments([(1.0, -2.0, 1.0, 2.0)])
    config = robot(WITH_ARM, lift=((0.2, -0.05), (0.5, -0.05), (0.5, 0.05), (0.2, 0.05)))
    assert len(config.outlines[0]) == 2
    p = plant(config, wall)
    command(p, 0.4, 0.4)
    p.step(4000)
    assert p.collisions == 1
    assert p.x_m == pytest.approx(0.5, abs=1e-3)


def test_somebody_stands_between_the_jaws() -> None:
    jaws = ((0.1, -0.4), (0.6, -0.4), (0.6, -0.3), (0.1, -0.3)), (
        (0.1, 0.3), (0.6, 0.3), (0.6, 0.4), (0.1, 0.4),
    )  # fmt: skip
    bar = ((0.1, -0.4), (0.18, -0.4), (0.18, 0.4), (0.1, 0.4))
    config = robot(WITH_ARM, left=jaws[1], right=jaws[0], bar=bar)
    p = plant(config, World.from_segments([]))
    p.discs = np.array([[0.45, 0.0, 0.2]])
    p.step(200)
    assert p.collisions == 0
    gap_m, _ = p.contact((0.45, 0.0), 0.2, (0.0, 0.0, 0.0))
    assert gap_m == pytest.approx(0.065)
    command(p, 0.4, 0.4)
    p.step(2000)
    assert p.x_m == pytest.approx(0.065, abs=2e-3)
