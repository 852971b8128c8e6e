"""The sonar ring against closed forms, a textbook ray caster, and its own statistics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_sim.config.config import load_robot
from firmware_sim.sensors.rays import blocked, cast_fan, fan_angles
from firmware_sim.sensors.sonar import SonarRing
from firmware_sim.world.world import World, load_world

CONFIGS = Path(__file__).parents[3] / "configs"
EXACT = {
    "simulation.sonar.sigma_m": 0.0,
    "simulation.sonar.sigma_per_m": 0.0,
    "simulation.sonar.outlier_probability": 0.0,
    "simulation.sonar.dropout_probability": 0.0,
    "simulation.sonar.crosstalk_probability": 0.0,
    "simulation.sonar.beam_deg": 30.0,
    "simulation.sonar.rays": 31,
    "simulation.sonar.max_incidence_deg": 40.0,
}
Mount = tuple[float, float, float]


def ring(
    walls: World | Sequence[tuple[float, float, float, float]],
    mounts: Sequence[Mount] = ((0.0, 0.0, 0.0),),
    seed: int = 1,
    **more: Any,
) -> SonarRing:
    overrides = {**EXACT, **{f"simulation.sonar.{key}": value for key, value in more.items()}}
    overrides["sonar"] = [
        {"name": str(i), "x_m": x, "y_m": y, "heading_deg": h} for i, (x, y, h) in enumerate(mounts)
    ]
    world = walls if isinstance(walls, World) else World.from_segments(list(walls))
    config = load_robot(CONFIGS / "diff_drive.toml", overrides)
    return SonarRing(config, world, np.random.default_rng(seed))


def one(sonar: SonarRing, x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> float:
    return sonar.fire(0, x, y, theta)[0]


@pytest.mark.parametrize("angle_deg", [0.0, 8.0, -15.0, 25.0, 40.0, -54.0])
def test_a_wall_at_an_angle_echoes_from_the_nearest_direction_in_the_cone(
    angle_deg: float,
) -> None:
    # A long wall 2 m away, its normal turned from the sonar's axis by the angle.
    angle = math.radians(angle_deg)
    nx, ny = math.cos(angle), math.sin(angle)
    wall = (2 * nx - 20 * ny, 2 * ny + 20 * nx, 2 * nx + 20 * ny, 2 * ny - 20 * nx)
    beyond = max(abs(angle) - math.radians(15.0), 0.0)
    assert one(ring([wall])) == pytest.approx(2.0 / math.cos(beyond), abs=1.1e-3)


@pytest.mark.parametrize("angle_deg", [56.0, -70.0])
def test_a_wall_too_flat_gives_no_echo(angle_deg: float) -> None:
    angle = math.radians(angle_deg)
    nx, ny = math.cos(angle), math.sin(angle)
    wall = (1 * nx - 20 * ny, 1 * ny + 20 * nx, 1 * nx + 20 * ny, 1 * ny - 20 * nx)
    assert one(ring([wall], max_range_m=8.0)) == math.inf


def test_a_flat_surface_hides_what_is_behind_it() -> None:
    shade = (0.25, -0.75, 2.25, 0.75)  # 37 degrees from the axis: incidence 53
    behind = (3.0, -5.0, 3.0, 5.0)
    assert one(ring([behind])) == 3.0
    narrow = {"beam_deg": 2.0, "rays": 3}
    assert one(ring([behind, shade], **narrow)) == math.inf


def test_a_concave_corner_echoes_from_its_point_and_a_convex_one_does_not() -> None:
    corner = [(2.0, -2.0, 2.0, 2.0), (2.0, 2.0, -2.0, 2.0)]
    # Looking into the corner both walls are met at 45 degrees, beyond the greatest incidence.
    narrow = {"beam_deg": 4.0, "rays": 5}
    into = math.radians(45.0)
    assert one(ring(corner, **narrow), theta=into) == pytest.approx(math.sqrt(8.0), abs=1e-3)
    assert one(ring(corner, corner_echo=False, **narrow), theta=into) == math.inf
    # From behind the same two walls are a convex corner.
    assert one(ring(corner, **narrow), 4.0, 4.0, into - math.pi) == math.inf


def test_a_corner_behind_something_is_not_heard() -> None:
    walls = [(2.0, -2.0, 2.0, 2.0), (2.0, 2.0, -2.0, 2.0), (0.9, 1.0, 1.4, 1.05)]
    narrow = {"beam_deg": 4.0, "rays": 5, "max_incidence_deg": 20.0}
    assert one(ring(walls, **narrow), theta=math.radians(45.0)) == math.inf


def test_the_first_echo_counts_not_the_mean() -> None:
    post = (1.0, 0.20, 1.0, 0.26)
    assert one(ring([(2.5, -5.0, 2.5, 5.0), post])) == pytest.approx(math.hypot(1.0, 0.2), abs=5e-3)


def test_mount_and_pose_of_the_robot_place_the_sonar() -> None:
    wall = [(3.0, -9.0, 3.0, 9.0), (-9.0, 2.0, 9.0, 2.0)]
    sonars = ring(wall, [(0.2, 0.0, 0.0), (0.0, 0.1, 90.0)])
    assert sonars.fire(0, 0.5, 0.5, 0.0)[:2] == pytest.approx((2.3, 1.4))
    turned = sonars.fire(0, 0.5, 0.5, math.pi / 2)
    assert turned[0] == pytest.approx(1.3)
    assert turned[1] == math.inf


def test_ranges_are_limited_below_and_above_and_in_whole_millimetres() -> None:
    assert one(ring([(0.01, -1.0, 0.01, 1.0)])) == 0.03
    assert one(ring([(4.01, -9.0, 4.01, 9.0)])) == math.inf
    assert one(ring([(1.23456, -9.0, 1.23456, 9.0)])) == 1.235
    assert one(ring([])) == math.inf


def test_a_group_has_four_and_missing_ones_are_nan() -> None:
    sonars = ring([(1.0, -9.0, 1.0, 9.0)], [(0.0, 0.0, 0.0)] * 6)
    assert sonars.groups == 2
    assert sonars.fire(0, 0.0, 0.0, 0.0) == (1.0, 1.0, 1.0, 1.0)
    last = sonars.fire(1, 0.0, 0.0, 0.0)
    assert last[:2] == (1.0, 1.0)
    assert all(math.isnan(r) for r in last[2:])
    assert all(math.isnan(r) for r in sonars.fire(3, 0.0, 0.0, 0.0))


def test_two_sonars_facing_one_wall_hear_each_other_on_the_mirrored_way() -> None:
    # Both 2 m from the wall and 0.6 m apart, turned towards each other by 12 degrees: neither
    # has its own echo within an incidence of 2 degrees, but the mirrored way is in both cones.
    wall = [(2.0, -9.0, 2.0, 9.0)]
    mounts = [(0.0, -0.3, 12.0), (0.0, 0.3, -12.0)]
    deaf = {"max_incidence_deg": 2.0, "beam_deg": 10.0, "rays": 11}
    quiet = ring(wall, mounts, **deaf)
    assert quiet.fire(0, 0.0, 0.0, 0.0)[:2] == (math.inf, math.inf)
    loud = ring(wall, mounts, crosstalk_probability=1.0, **deaf)
    expected = math.hypot(4.0, 0.6) / 2
    assert loud.fire(0, 0.0, 0.0, 0.0)[:2] == pytest.approx((expected, expected), abs=1e-3)
    # With something in between it is quiet again.
    screened = ring([*wall, (0.5, -1.0, 0.5, 1.0)], mounts, crosstalk_probability=1.0, **deaf)
    assert screened.fire(0, 0.0, 0.0, 0.0)[:2] == (math.inf, math.inf)


def test_cross_talk_comes_as_often_as_it_should() -> None:
    mounts = [(0.0, -0.3, 12.0), (0.0, 0.3, -12.0)]
    deaf = {"max_incidence_deg": 2.0, "beam_deg": 10.0, "rays": 11}
    sonars = ring([(2.0, -9.0, 2.0, 9.0)], mounts, crosstalk_probability=0.2, **deaf)
    heard = sum(one(sonars) < math.inf for _ in range(4000))
    assert abs(heard - 800) < 4 * math.sqrt(4000 * 0.2 * 0.8)


@pytest.mark.parametrize("distance", [0.5, 3.5])
def test_noise_grows_with_range(distance: float) -> None:
    sonars = ring([(distance, -9.0, distance, 9.0)], sigma_m=0.01, sigma_per_m=0.01)
    samples = np.array([one(sonars) for _ in range(3000)])
    sigma = 0.01 + 0.01 * distance
    assert samples.mean() == pytest.approx(distance, abs=4 * sigma / math.sqrt(3000))
    assert samples.std() == pytest.approx(sigma, rel=4 / math.sqrt(2 * 3000))


def test_drop_outs_and_outliers_come_as_often_as_they_should() -> None:
    sonars = ring([(2.0, -9.0, 2.0, 9.0)], dropout_probability=0.1, outlier_probability=0.2, seed=5)
    samples = np.array([one(sonars) for _ in range(6000)])
    lost = np.count_nonzero(np.isinf(samples))
    wrong = np.count_nonzero(np.isfinite(samples) & (samples != 2.0))
    assert abs(lost - 600) < 4 * math.sqrt(6000 * 0.09)
    assert abs(wrong - 0.9 * 1200) < 4 * math.sqrt(6000 * 0.18 * 0.82)
    # Half of the wrong ones are short, of the others half.
    short = np.count_nonzero(samples < 2.0)
    assert short / wrong == pytest.approx(0.75, abs=0.06)


def test_the_same_seed_gives_the_same_readings() -> None:
    flat = load_world(CONFIGS / "worlds" / "flat.toml")
    config = load_robot(CONFIGS / "diff_drive.toml")

    def story(seed: int) -> list[tuple[float, ...]]:
        sonars = SonarRing(config, flat, np.random.default_rng(seed))
        sonars.warm()
        return [sonars.fire(i % 2, 1.0 + 0.1 * i, 1.0, 0.1 * i) for i in range(30)]

    assert story(4) == story(4)
    assert story(4) != story(5)


def cast_plainly(
    x: float, y: float, axis: float, angles: np.ndarray, reach: float, walls: np.ndarray
) -> np.ndarray:
    """Cast every ray at every wall, by solving two equations each time."""
    ranges = np.full(len(angles), np.inf)
    for i, angle in enumerate(angles):
        d = np.array([math.cos(axis + angle), math.sin(axis + angle)])
        for ax, ay, bx, by in walls:
            matrix = np.array([d, [ax - bx, ay - by]]).T
            if abs(np.linalg.det(matrix)) < 1e-12:
                continue
            r, u = np.linalg.solve(matrix, [ax - x, ay - y])
            if r >= 0 and -1e-9 <= u <= 1 + 1e-9 and r <= reach:
                ranges[i] = min(ranges[i], r)
    return ranges


@example(2, 360.0, 3)
@given(
    st.integers(0, 2**32), st.sampled_from([15.0, 60.0, 120.0, 270.0, 360.0]), st.integers(2, 40)
)
def test_the_fan_agrees_with_casting_every_ray_at_every_wall(
    seed: int, opening_deg: float, rays: int
) -> None:
    rng = np.random.default_rng(seed)
    walls = rng.uniform(-4, 4, (int(rng.integers(1, 12)), 4))
    angles = fan_angles(rays, math.radians(opening_deg))
    axis, reach = float(rng.uniform(-7, 7)), float(rng.uniform(1, 8))
    ranges, hits = np.empty(rays), np.empty(rays, dtype=np.int32)
    cast_fan(0.3, -0.2, axis, angles, reach, walls, ranges, hits)
    expected = cast_plainly(0.3, -0.2, axis, angles, reach, walls)
    assert ranges == pytest.approx(expected, rel=1e-6)
    assert np.array_equal(hits >= 0, np.isfinite(ranges))


def test_in_a_closed_room_no_ray_slips_through_a_corner() -> None:
    walls = np.array([(0, 0, 3, 0), (3, 0, 3, 2), (3, 2, 0, 2), (0, 2, 0, 0)], dtype=np.float64)
    angles = fan_angles(720, 2 * math.pi)
    ranges, hits = np.empty(720), np.empty(720, dtype=np.int32)
    for x, y, axis in [(1.0, 1.0, math.pi / 4), (1.5, 1.0, 0.1), (2.0, 1.0, math.pi / 4)]:
        cast_fan(x, y, axis, angles, 10.0, walls, ranges, hits)
        assert np.all(np.isfinite(ranges))


def test_sight_is_blocked_by_what_stands_between() -> None:
    walls = np.array([(1.0, -1.0, 1.0, 1.0)])
    assert blocked(0.0, 0.0, 2.0, 0.5, walls)
    assert not blocked(0.0, 0.0, 0.9, 0.5, walls)
    assert not blocked(0.0, 0.0, 1.0, 0.0, walls)
    assert not blocked(0.0, 0.0, 2.0, 3.0, walls)
