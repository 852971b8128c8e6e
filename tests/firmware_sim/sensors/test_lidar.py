"""The lidar against a room in closed form, and its noise against what is said of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_sim.config.parameters import LidarParameters
from firmware_sim.sensors.lidar import Lidar
from firmware_sim.world.world import World

ROOM = World.from_segments([(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)])
EXACT = LidarParameters(sigma_m=0.0, dropout_probability=0.0)


def room_range(x: float, y: float, bearing: float) -> float:
    """Range in the 6 m by 4 m room: the nearest of the four walls ahead."""
    c, s = math.cos(bearing), math.sin(bearing)
    ranges = []
    if c != 0:
        ranges.append((6 - x) / c if c > 0 else -x / c)
    if s != 0:
        ranges.append((4 - y) / s if s > 0 else -y / s)
    return min(ranges)


@pytest.mark.parametrize("fov_deg", [90.0, 270.0, 360.0])
def test_a_scan_of_a_room_is_its_closed_form(fov_deg: float) -> None:
    p = LidarParameters(
        x_m=0.1, heading_deg=20.0, beams=181, fov_deg=fov_deg, sigma_m=0.0, dropout_probability=0.0
    )
    lidar = Lidar(p, ROOM, np.random.default_rng(1))
    scan = lidar.scan(2.0, 1.0, 0.5)
    at = (2.0 + 0.1 * math.cos(0.5), 1.0 + 0.1 * math.sin(0.5))
    expected = [room_range(*at, 0.5 + angle) for angle in lidar.angles_rad]
    assert scan == pytest.approx(expected, rel=1e-9)
    width = lidar.angles_rad[-1] - lidar.angles_rad[0]
    full = math.radians(fov_deg)
    assert width == pytest.approx(full if fov_deg < 360 else full * 180 / 181)
    assert lidar.angles_rad.mean() == pytest.approx(
        math.radians(20.0) - (0 if fov_deg < 360 else math.pi / 181)
    )


def test_what_is_too_far_or_too_near_is_not_seen() -> None:
    walls = World.from_segments([(13, -90, 13, 90), (-0.04, -9, -0.04, 9)])
    scan = Lidar(EXACT, walls, np.random.default_rng(1)).scan(0.0, 0.0, 0.0)
    assert scan[0] == math.inf
    assert scan[180] == math.inf
    assert np.all(scan[np.isfinite(scan)] >= 0.05)


def test_noise_and_drop_outs_are_as_large_as_is_said() -> None:
    p = LidarParameters(beams=20_00, sigma_m=0.02, dropout_probability=0.05)
    noisy = Lidar(p, ROOM, np.random.default_rng(3)).scan(3.0, 2.0, 0.1)
    clean = LidarParameters(beams=20_00, sigma_m=0.0, dropout_probability=0.0)
    error = noisy - Lidar(clean, ROOM, np.random.default_rng(3)).scan(3.0, 2.0, 0.1)
    kept = np.isfinite(noisy)
    assert abs(np.count_nonzero(~kept) - 100) < 4 * math.sqrt(2000 * 0.05)
    assert error[kept].std() == pytest.approx(0.02, rel=0.07)
    assert abs(error[kept].mean()) < 4 * 0.02 / math.sqrt(1900)


def test_scans_differ_from_each_other_and_repeat_with_the_seed() -> None:
    a, b = (Lidar(LidarParameters(), ROOM, np.random.default_rng(3)) for _ in range(2))
    first = a.scan(3.0, 2.0, 0.0)
    assert np.array_equal(first, b.scan(3.0, 2.0, 0.0))
    assert not np.array_equal(first, a.scan(3.0, 2.0, 0.0))
