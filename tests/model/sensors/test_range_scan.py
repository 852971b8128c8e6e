"""What a scan refuses, and where its points lie."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.model.sensors.range_scan import RangeScan

ANGLES = np.array([-0.5, 0.0, 0.5])


def scan(**changes) -> RangeScan:
    values = {
        "stamp_ns": 1,
        "angles_rad": ANGLES,
        "ranges_m": np.array([1.0, math.inf, math.nan]),
        "max_range_m": 4.0,
        "sigmas_m": np.array([0.1, math.nan, math.nan]),
    }
    return RangeScan(**(values | changes))


def test_sigmas_may_be_unknown_and_are_kept_where_known() -> None:
    assert scan(sigmas_m=None).sigmas_m is None
    assert scan().sigmas_m[0] == 0.1


@pytest.mark.parametrize(
    ("sigmas_m", "message"),
    [
        ([0.1, 0.1], r"sigmas_m \(2,\) must be of the shape of ranges_m \(3,\)"),
        ([-0.1, 0.1, 0.1], "must not be negative"),
        ([math.nan, 0.1, 0.1], "finite where there is a range"),
        ([math.inf, 0.1, 0.1], "finite where there is a range"),
    ],
)
def test_sigmas_that_cannot_be_are_refused(sigmas_m: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        scan(sigmas_m=np.array(sigmas_m))


def test_points_are_where_the_beams_end() -> None:
    points = scan(x_m=0.2, y_m=-0.1).points_base()
    assert points == pytest.approx(
        np.array([[0.2 + math.cos(-0.5), -0.1 + math.sin(-0.5)]]), abs=1e-12
    )
