"""A lidar that sweeps while the robot moves: each beam from where it was at its time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_sim.config.parameters import LidarParameters
from firmware_sim.sensors.lidar import Lidar
from tests.firmware_sim.sensors.test_lidar import ROOM, room_range


@pytest.mark.parametrize("sweep_s", [0.1, -0.1])
def test_each_beam_is_the_closed_form_from_its_own_place(sweep_s: float) -> None:
    p = LidarParameters(
        x_m=0.2, heading_deg=30.0, sweep_s=sweep_s, sigma_m=0.0, dropout_probability=0.0
    )
    lidar = Lidar(p, ROOM, np.random.default_rng(1))
    ages_s = lidar.ages_s
    assert ages_s[0] == (0.1 if sweep_s > 0.0 else 0.0)
    assert ages_s[-1] == (0.0 if sweep_s > 0.0 else 0.1)
    thetas = 0.4 - 2.0 * ages_s
    poses = np.stack([3.0 - 0.8 * ages_s, 2.0 + 0.1 * ages_s, thetas], axis=1)
    expected = [
        room_range(x + 0.2 * math.cos(theta), y + 0.2 * math.sin(theta), theta + angle)
        for (x, y, theta), angle in zip(poses, lidar.angles_rad, strict=True)
    ]
    assert lidar.sweep(poses) == pytest.approx(expected, rel=1e-9)


def test_a_sweep_from_one_place_is_a_scan() -> None:
    exact = {"sigma_m": 0.0, "dropout_probability": 0.0}
    scan = Lidar(LidarParameters(**exact), ROOM, np.random.default_rng(1)).scan(2.0, 1.0, 0.5)
    swept = Lidar(LidarParameters(sweep_s=0.1, **exact), ROOM, np.random.default_rng(1))
    assert swept.sweep(np.full((360, 3), (2.0, 1.0, 0.5))) == pytest.approx(scan, rel=1e-9)


def test_a_sweep_longer_than_a_turn_is_refused() -> None:
    with pytest.raises(ValueError, match=r"sweep_s: 0.2 is longer than a turn at rate_hz = 10"):
        LidarParameters(sweep_s=0.2, rate_hz=10.0)
