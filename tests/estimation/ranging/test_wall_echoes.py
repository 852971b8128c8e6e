"""Echoes of walls, against geometry worked out by hand and by rays."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firmware_sim.config.config import load_robot
from firmware_sim.sensors.sonar import SonarRing
from firmware_sim.world.world import load_world
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.ranging.grid_echoes import GridEchoes
from robotctl.estimation.ranging.sonar_cones import SonarCones
from robotctl.estimation.ranging.wall_echoes import WallEchoes
from robotctl.model.wall_map import WallMap

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
AHEAD = np.zeros((1, 3))
FAR_M = 4.0


def echoes(walls: list[list[float]], beam_deg: float, limit_deg: float, mounts=AHEAD) -> WallEchoes:
    return WallEchoes(
        WallMap(np.array(walls, float)),
        SonarCones(mounts, math.radians(beam_deg), math.radians(limit_deg), FAR_M),
    )


def measured(found: WallEchoes, x: float, y: float, theta: float) -> float:
    return found.ranges(np.array([[x, y, theta]]), np.array([0])).item()


def test_a_narrow_beam_measures_what_the_notes_say_from_both_sides_of_a_wall():
    """Notes, section 4.1: m and beta of the line through A and B, with the errata's conditions."""
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(250):
        ax, ay, bx, by, x, y = rng.uniform(-2.0, 2.0, 6)
        theta = rng.uniform(-math.pi, math.pi)
        across = (by - ay) * math.cos(theta) - (bx - ax) * math.sin(theta)
        m = ((by - ay) * (ax - x) - (bx - ax) * (ay - y)) / across
        length = math.hypot(bx - ax, by - ay)
        cos_beta = (math.cos(theta) * (ay - by) + math.sin(theta) * (bx - ax)) / length
        beta = math.acos(min(abs(cos_beta), 1.0))
        hx, hy = x + m * math.cos(theta), y + m * math.sin(theta)
        share = ((hx - ax) * (bx - ax) + (hy - ay) * (by - ay)) / length**2
        if min(abs(m), abs(share), abs(share - 1), abs(beta - 0.6)) < 0.01 or abs(m) > 3.9:
            continue
        expected = m if m > 0 and 0 < share < 1 and beta < 0.6 else math.inf
        found = echoes([[ax, ay, bx, by]], 1e-4, math.degrees(0.6))
        assert measured(found, x, y, theta) == pytest.approx(expected, rel=1e-4)
        hits += math.isfinite(expected)
    assert hits > 10


def test_the_nearest_wall_wins_and_a_parallel_one_is_not_met():
    found = echoes([[2, -1, 2, 1], [1, -1, 1, 1], [0, 0.5, 3, 0.5]], 1.0, 35.0)
    assert measured(found, 0.0, 0.0, 0.0) == pytest.approx(1.0, rel=1e-3)
    assert measured(found, 1.5, 0.0, 0.0) == pytest.approx(0.5, rel=1e-3)
    assert measured(found, 2.5, 0.0, 0.0) == math.inf


def test_a_wide_beam_measures_to_the_foot_of_the_normal_while_that_is_in_the_cone():
    found = echoes([[1, -3, 1, 3]], 30.0, 40.0)
    for deg in (0, 7, 14.9, -14.9):
        assert measured(found, 0.0, 0.0, math.radians(deg)) == pytest.approx(1.0)
    at_edge = 1.0 / math.cos(math.radians(20 - 15))
    assert measured(found, 0.0, 0.0, math.radians(20)) == pytest.approx(at_edge)
    beyond = 1.0 / math.cos(math.radians(54 - 15))
    assert measured(found, 0.0, 0.0, math.radians(-54)) == pytest.approx(beyond)
    assert measured(found, 0.0, 0.0, math.radians(56)) == math.inf


def test_a_wall_met_too_flatly_hides_what_is_behind_it():
    flat = [0.5, -0.5, 2.5, 0.5]
    behind = [3, -2, 3, 2]
    assert measured(echoes([behind], 10.0, 35.0), 0.0, 0.0, 0.0) == pytest.approx(3.0)
    assert measured(echoes([behind, flat], 10.0, 35.0), 0.0, 0.0, 0.0) == math.inf


def test_a_concave_corner_answers_from_any_direction_and_a_convex_one_does_not():
    corner = [[2, 0, 4, 0], [2, 0, 2, 2]]
    inside = echoes(corner, 20.0, 5.0)
    for x, y in ((3.5, 0.6), (2.4, 1.2), (3.0, 1.0)):
        away = math.hypot(x - 2, y)
        assert measured(inside, x, y, math.atan2(-y, 2 - x)) == pytest.approx(away)
    assert measured(inside, 0.5, -1.0, math.atan2(1.0, 1.5)) == math.inf


def fan(walls: np.ndarray, pose: np.ndarray, half: float, limit: float) -> float:
    """Nearest reflecting wall by 1441 rays, each stopped by the first wall that it meets."""
    angles = pose[2] + np.linspace(-half, half, 1441)
    way = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]
    a, e = walls[:, :2], walls[:, 2:] - walls[:, :2]
    across = way[..., 0] * e[:, 1] - way[..., 1] * e[:, 0]
    d = a - pose[:2]
    t = (d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]) / across
    u = (d[:, 0] * way[..., 1] - d[:, 1] * way[..., 0]) / across
    t = np.where((t > 0) & (u >= 0) & (u <= 1), t, np.inf)
    first = np.argmin(t, axis=1)
    rays = np.arange(len(angles))
    reflects = np.abs(across[rays, first]) >= math.cos(limit) * np.hypot(*e[first].T)
    return float(np.where(reflects, t[rays, first], np.inf).min())


def test_among_many_walls_the_range_is_that_of_a_dense_fan_of_rays():
    rng = np.random.default_rng(2)
    agree = 0
    for _ in range(60):
        start = rng.uniform(-3.0, 3.0, (12, 2))
        walls = np.hstack([start, start + rng.uniform(-1.5, 1.5, (12, 2))])  # no corners
        mount = np.array([[0.2, -0.1, 0.5]])
        cones = SonarCones(mount, math.radians(25), math.radians(35), FAR_M)
        found = WallEchoes(WallMap(walls), cones)
        poses = rng.uniform([-2, -2, -3], [2, 2, 3], (20, 3))
        for pose, value in zip(poses, found.ranges(poses, np.array([0]))[:, 0], strict=True):
            c, s = math.cos(pose[2]), math.sin(pose[2])
            at = pose + np.array([c * 0.2 + s * 0.1, s * 0.2 - c * 0.1, 0.5])
            wanted = fan(walls, at, math.radians(12.5), math.radians(35))
            wanted = wanted if wanted <= FAR_M else math.inf
            agree += wanted == value or abs(wanted - value) < 0.005
    assert agree >= 0.97 * 60 * 20  # A wall whose nearest point is hidden may yet be seen in part.


@pytest.mark.parametrize("name", ["empty_room", "flat", "office", "corridor_loop"])
def test_ranges_are_those_of_the_firmware_simulator_s_own_geometry(name):
    robot = load_robot(CONFIGS / "diff_drive.toml")
    sonar = replace(
        robot.simulation.sonar,
        rays=101,
        sigma_m=0.0,
        sigma_per_m=0.0,
        outlier_probability=0.0,
        dropout_probability=0.0,
        crosstalk_probability=0.0,
    )
    robot = replace(robot, simulation=replace(robot.simulation, sonar=sonar))
    world = load_world(CONFIGS / "worlds" / f"{name}.toml")
    rng = np.random.default_rng(3)
    ring = SonarRing(robot, world, rng)
    mounts = np.array([(m.x_m, m.y_m, m.heading_rad) for m in robot.sonar])
    limits = (math.radians(sonar.beam_deg), math.radians(sonar.max_incidence_deg))
    poses = free_poses(world, rng, 150)
    wanted = np.array([ring.fire(0, *pose) + ring.fire(1, *pose) for pose in poses])
    walls = WallMap(world.segments)
    cones = SonarCones(mounts, *limits, sonar.max_range_m)
    on_walls = WallEchoes(walls, cones)
    on_cells = GridEchoes(grid_of_walls(walls), cones)
    sonars = np.arange(len(mounts))
    assert alike(on_walls.ranges(poses, sonars), wanted, 0.01) > 0.98
    assert alike(on_cells.ranges(poses, sonars), wanted, 0.08) > 0.88


def free_poses(world, rng: np.random.Generator, n: int) -> np.ndarray:
    """Poses that a robot of 0.2 m fits to."""
    low_x, low_y, high_x, high_y = world.bounds
    around = [(0.2 * i, 0.2 * j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    found = []
    while len(found) < n:
        x = rng.uniform(low_x + 0.3, high_x - 0.3)
        y = rng.uniform(low_y + 0.3, high_y - 0.3)
        if not any(world.solid_at(x + dx, y + dy) for dx, dy in around):
            found.append((x, y, rng.uniform(-math.pi, math.pi)))
    return np.array(found)


def alike(found: np.ndarray, wanted: np.ndarray, tolerance: float) -> float:
    """Share of ranges that agree; both without an echo agree, too."""
    both = np.isfinite(found) & np.isfinite(wanted)
    off = np.where(both, found, 0.0) - np.where(both, wanted, 0.0)
    same = np.isfinite(found) == np.isfinite(wanted)
    return float(np.mean(same & (np.abs(off) < tolerance)))
