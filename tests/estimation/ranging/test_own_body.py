"""Echoes of the robot itself in a lidar's scan, against an exact geometric oracle."""

import math

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.ranging.own_body import NEAR_M, without_body
from robotctl.messages.estimation import LidarScan
from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import side_rows
from tests.model.polygon_bodies import bodies

BEAMS = 90


def message(ranges):
    step = math.tau / BEAMS
    data = np.asarray(ranges, "<f4").tobytes()
    return LidarScan(7, 0.05, -0.02, -math.pi, step, 8.0, data, "top", 0.08)


@settings(max_examples=60)
@given(bodies(), st.integers(0, 2**32 - 1))
def test_what_lies_in_the_body_is_no_reading_and_all_else_is_as_it_was(body, seed):
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.02, 1.5, BEAMS).astype("<f4")
    ranges[rng.random(BEAMS) < 0.1] = np.inf
    ranges[rng.random(BEAMS) < 0.05] = np.nan
    scan = message(ranges)
    kept = without_body(scan, side_rows(body))
    assert (kept.stamp_ns, kept.name, kept.sweep_s) == (7, "top", 0.08)
    after = np.frombuffer(kept.ranges, "<f4")
    shape = shapely.union_all([shapely.Polygon(each) for each in body.outlines])
    # A corner of one piece stays as sharp as it is; that of several reaches out by so much at most.
    grown = shape.buffer(NEAR_M + 1e-5, join_style="mitre", mitre_limit=1000.0)
    if not body.is_convex:
        grown = shape.buffer(math.sqrt(2.0) * NEAR_M + 1e-5, quad_segs=64)
    angles = scan.first_rad + scan.step_rad * np.arange(BEAMS)
    for reach, left, angle in zip(ranges, after, angles, strict=True):
        if not math.isfinite(reach):
            assert np.array_equal(left, reach, equal_nan=True)
            continue
        point = shapely.Point(0.05 + reach * math.cos(angle), -0.02 + reach * math.sin(angle))
        if shape.distance(point) < NEAR_M - 1e-5:
            assert math.isnan(left)
        elif not grown.contains(point):
            assert left == reach


def test_what_is_no_scan_is_left_to_who_refuses_it():
    broken = LidarScan(0, 0.0, 0.0, 0.0, 0.1, 8.0, b"123")
    body = side_rows(Footprint.rectangle(-0.2, 0.2, 0.2))
    assert without_body(broken, body) is broken
