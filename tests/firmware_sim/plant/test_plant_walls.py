"""The plant against walls: it stops, slides, counts, and never gets through."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.config.config import load_robot
from firmware_sim.errors import SimulationError
from firmware_sim.plant.axis import Mode
from firmware_sim.plant.plant import Plant
from firmware_sim.world.world import World, load_world
from tests.firmware_sim.plant.plants import command

CONFIGS = Path(__file__).parents[3] / "configs"
ROBOTS = {
    name: load_robot(CONFIGS / f"{name}.toml") for name in ("diff_drive", "tricycle", "ackermann")
}
FLAT = load_world(CONFIGS / "worlds" / "flat.toml")
FRONT_M = 0.185


def plant(world: World, name: str = "diff_drive", seed: int = 1) -> Plant:
    return Plant(ROBOTS[name], world, np.random.default_rng(seed))


def deepest(p: Plant, name: str, world: World) -> float:
    """How deep a wall is inside the outline [m]; an oracle by clipping, one wall at a time."""
    corners = np.array(ROBOTS[name].simulation.body)
    c, s = math.cos(p.theta_rad), math.sin(p.theta_rad)
    points = corners @ np.array([[c, s], [-s, c]]) + (p.x_m, p.y_m)
    worst = 0.0
    for ax, ay, bx, by in world.segments:
        # Clip the wall to the outline (Cyrus and Beck), then see how far its middle is inside.
        start, end, inside = 0.0, 1.0, True
        depths = []
        for (px, py), (qx, qy) in zip(points, np.roll(points, -1, axis=0), strict=True):
            nx, ny = qy - py, px - qx
            if (points.mean(axis=0) - (px, py)) @ (nx, ny) > 0:
                nx, ny = -nx, -ny
            length = math.hypot(nx, ny)
            nx, ny = nx / length, ny / length
            outside_a = (ax - px) * nx + (ay - py) * ny
            outside_b = (bx - px) * nx + (by - py) * ny
            if outside_a > 0 and outside_b > 0:
                inside = False
                break
            if outside_a * outside_b < 0:
                t = outside_a / (outside_a - outside_b)
                start, end = (max(start, t), end) if outside_a > 0 else (start, min(end, t))
            depths.append((outside_a, outside_b))
        if inside and start < end:
            middle = (start + end) / 2
            worst = max(worst, min(-(a + (b - a) * middle) for a, b in depths))
    return worst


def wander(p: Plant, rng: np.random.Generator) -> None:
    """One of many random drives, forwards mostly."""
    left, right = rng.uniform(-0.4, 1.0) + rng.uniform(-0.2, 0.2, 2)
    command(p, *np.clip([left, right], -1.0, 1.0), float(rng.uniform(-0.6, 0.6)))
    p.step(int(rng.integers(100, 1000)))


def test_the_oracle_sees_a_wall_inside_the_outline() -> None:
    p = plant(World.from_segments([]))
    assert deepest(p, "diff_drive", World.from_segments([(0.1, -1.0, 0.1, 1.0)])) > 0.05
    assert deepest(p, "diff_drive", World.from_segments([(0.2, -1.0, 0.2, 1.0)])) == 0.0


def test_driving_head_on_into_a_wall_stops_there_and_counts_once() -> None:
    p = plant(World.from_segments([(1.0, -2.0, 1.0, 2.0)]))
    command(p, 0.4, 0.4)
    p.step(1000)
    while p.collisions == 0:
        speed = p.v_m_s
        p.step(1)
    assert p.impact_m_s == pytest.approx(speed, rel=0.02)
    p.step(2000)
    assert p.collisions == 1
    assert p.touching
    assert p.x_m + FRONT_M == pytest.approx(1.0, abs=3e-4)
    assert p.v_m_s == pytest.approx(0.0, abs=1e-6)
    assert p.axes[0].current_a > 1.0


@pytest.mark.parametrize("bounds", ["", "bounds = [-0.6, -0.6, 0.1, 0.6]\n"])
def test_an_obstacle_beyond_all_walls_and_bounds_is_driven_against(
    bounds: str, tmp_path: Path
) -> None:
    path = tmp_path / "beyond.toml"
    path.write_text(
        '[world]\nname = "beyond"\nstart = { x_m = 0.0, y_m = 0.0 }\n' + bounds
        + "[[wall]]\npoints = [[-0.5, -0.5], [-0.5, 0.5]]\n"
        "[[obstacle]]\ncentre = [2.5, 0.0]\nsize = [0.2, 0.6]\nheight_m = 0.1\n"
    )  # fmt: skip
    world = load_world(path)
    assert world.bounds == ((-0.6, -0.6, 0.1, 0.6) if bounds else (-0.5, -0.5, 2.6, 0.5))
    p = plant(world)
    command(p, 0.6, 0.6)
    p.step(6000)
    assert p.collisions == 1
    assert p.touching
    assert p.x_m + FRONT_M == pytest.approx(2.4, abs=1e-3)


def test_pushing_hard_spins_the_wheels_and_pushing_softly_stalls_them() -> None:
    hard, soft = (plant(World.from_segments([(0.3, -2.0, 0.3, 2.0)])) for _ in range(2))
    command(hard, 0.9, 0.9)
    command(soft, 0.15, 0.15)
    hard.step(2000)
    soft.step(2000)
    assert hard.axes[0].speed_rad_s > 5.0
    assert soft.axes[0].speed_rad_s == pytest.approx(0.0, abs=0.05)
    assert soft.axes[0].current_a == pytest.approx(
        (0.15 - 0.02) / 0.98 * soft.bus_voltage_v / 1.56, rel=0.03
    )


def test_coming_back_later_is_another_collision() -> None:
    p = plant(World.from_segments([(0.5, -2.0, 0.5, 2.0)]))
    for expected in (1, 2, 3):
        command(p, 0.3, 0.3)
        p.step(1500)
        assert p.collisions == expected
        command(p, -0.3, -0.3)
        p.step(1000)
        assert not p.touching


@pytest.mark.parametrize(("heading_deg", "friction"), [(10.0, 0.3), (-20.0, 0.3), (35.0, 0.0)])
def test_a_grazing_robot_slides_along_the_wall(heading_deg: float, friction: float) -> None:
    side = math.copysign(1.0, heading_deg)
    config = load_robot(
        CONFIGS / "diff_drive.toml",
        {"simulation.wall_friction": friction, "simulation.wheels.floor_noise": 0.0},
    )
    world = World.from_segments([(-5.0, side * 0.4, 50.0, side * 0.4)])
    p = Plant(config, world, np.random.default_rng(1))
    p.place(0.0, 0.0, math.radians(heading_deg))
    command(p, 0.4, 0.4)
    p.step(6000)
    assert p.collisions == 1
    assert p.x_m > 1.0
    # It has aligned itself with the wall.
    assert abs(p.theta_rad) < math.radians(5.0)


def test_a_wall_of_many_pieces_is_as_smooth_as_one() -> None:
    ends = np.linspace(-5.0, 10.0, 301)
    pieces = [(a, 0.4, b, 0.4) for a, b in itertools.pairwise(ends)]
    whole, pieced = (
        plant(World.from_segments(walls)) for walls in ([(-5.0, 0.4, 10.0, 0.4)], pieces)
    )
    for p in (whole, pieced):
        p.place(0.0, 0.0, math.radians(15.0))
        command(p, 0.39, 0.4)
        p.step(4000)
    assert whole.collisions > 0
    assert pieced.x_m == pytest.approx(whole.x_m, rel=0.01)
    assert pieced.x_m > 0.7


def test_a_touch_at_rest_is_no_collision() -> None:
    p = plant(World.from_segments([(FRONT_M + 2e-4, -2.0, FRONT_M + 2e-4, 2.0)]))
    command(p, 0.0, 0.0, mode=Mode.SHORTED)
    p.step(1000)
    assert p.collisions == 0
    assert p.x_m == pytest.approx(0.0, abs=1e-12)


def test_far_walls_change_nothing() -> None:
    room, nothing = plant(FLAT), plant(World.from_segments([], FLAT.start))
    for p in (room, nothing):
        command(p, 0.3, 0.29)
        p.step(3000)
    assert (room.x_m, room.y_m, room.theta_rad) == (nothing.x_m, nothing.y_m, nothing.theta_rad)


def test_a_turning_robot_is_stopped_by_the_end_of_a_wall() -> None:
    # The wall's end is inside the circle of the corners, beside the robot's flank.
    p = plant(World.from_segments([(0.05, 0.18, 0.05, 2.0)]))
    command(p, -0.3, 0.3)
    p.step(3000)
    assert p.collisions >= 1
    assert deepest(p, "diff_drive", World.from_segments([(0.05, 0.18, 0.05, 2.0)])) < 1e-3


@pytest.mark.parametrize("pose", [(4.95, 1.0, 0.0), (0.3, 4.4, 1.0), (0.1, 2.0, 0.0)])
def test_standing_in_a_wall_is_refused(pose: tuple[float, float, float]) -> None:
    p = plant(FLAT)
    before = (p.x_m, p.y_m)
    with pytest.raises(SimulationError, match="is in the way"):
        p.place(*pose)
    assert (p.x_m, p.y_m) == before


@pytest.mark.parametrize("name", list(ROBOTS))
@given(seed=st.integers(0, 10_000))
@settings(max_examples=12, deadline=None)
def test_no_driving_whatever_gets_into_a_wall(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = plant(FLAT, name, seed)
    for _ in range(40):
        wander(p, rng)
        assert math.isfinite(p.x_m + p.y_m + p.v_m_s + p.axes[0].current_a)
        assert deepest(p, name, FLAT) < 1e-3
        assert 0.0 < p.x_m < 8.0
        assert 0.0 < p.y_m < 5.0


def test_random_driving_does_collide_so_the_test_above_means_something() -> None:
    for name in ROBOTS:
        collisions = 0
        for seed in range(5):
            rng = np.random.default_rng(seed)
            p = plant(FLAT, name, seed)
            for _ in range(40):
                wander(p, rng)
            collisions += p.collisions
        assert collisions > 10


@pytest.mark.parametrize("name", ["tricycle", "ackermann"])
def test_a_corner_beyond_a_walls_line_past_its_end_touches_nothing(name: str) -> None:
    """Each body has the wall's end beside it, and corners and middle on both sides of its line."""
    p = plant(World.from_segments([(0.0, 0.0, 3.0, 0.0)], (-2.0, 0.0, 0.0)), name)
    ring = np.array(ROBOTS[name].simulation.body)
    sides = np.roll(ring, -1, axis=0) - ring
    rng, seen = np.random.default_rng(1), 0
    for _ in range(4000):
        side, heading_rad = int(rng.integers(len(ring))), float(rng.uniform(-math.pi, math.pi))
        outward = np.array([sides[side, 1], -sides[side, 0]]) / np.hypot(*sides[side])
        end = ring[side] + rng.random() * sides[side] + rng.uniform(0.012, 0.05) * outward
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        turn = np.array([[c, s], [-s, c]])
        corners = (ring - end) @ turn
        if not np.any((corners[:, 0] >= 0.0) & (corners[:, 1] * corners[:, 1].mean() < 0.0)):
            continue
        points = (ring + np.linspace(0.0, 1.0, 60)[:, None, None] * sides - end) @ turn
        x, y = points.reshape(-1, 2).T
        if np.hypot(x - np.clip(x, 0.0, 3.0), y).min() < 0.01:
            continue
        seen += 1
        p.place(*(-end @ turn).tolist(), heading_rad)
        p.step(3)
        assert p._b["contacts"] == 0
    assert seen >= 10


def test_a_corner_past_a_doors_jamb_is_not_in_the_wall() -> None:
    """Found in a drive: the tricycle left a door of the office, 2.5 cm off its jamb."""
    p = plant(load_world(CONFIGS / "worlds" / "office.toml"), "tricycle")
    p.place(24.3231, 6.4957, -2.1833)
    command(p, -0.2, -0.2)
    p.step(50)
    assert p._b["contacts"] == 0
    assert p.collisions == 0
