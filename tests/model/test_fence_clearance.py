"""The distance of a body from its fence, against points, sampled densely, and shapely."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from robotctl.model.fence import Fence, FenceCircle, FencePolygon
from robotctl.model.fence_clearance import body_clearance
from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import samples
from tests.model.polygon_bodies import bodies, shape_of

BODY = Footprint.rectangle(-0.25, 0.2, 0.18)
ARM = Footprint(((0.1, -0.6), (0.3, -0.5), (0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2)))
"""Of a robot with an arm to its right."""
HOLLOW = Footprint(
    ((0.3, -0.6), (0.3, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.1, -0.2), (0.1, -0.6)),
    (((-0.5, -0.1), (-0.4, -0.1), (-0.4, 0.1), (-0.5, 0.1)),),
)
"""Of one with such an arm, free floor behind it, and a part that stands apart."""
places = st.floats(-3.0, 3.0).map(lambda value: round(value, 3))
points = st.tuples(places, places)


@st.composite
def fences(draw):
    polygons = tuple(
        FencePolygon(tuple(draw(st.lists(points, min_size=3, max_size=6))), draw(st.booleans()))
        for _ in range(draw(st.integers(0, 2)))
    )
    circles = tuple(
        FenceCircle(*draw(points), draw(st.floats(0.05, 3.0)), draw(st.booleans()))
        for _ in range(draw(st.integers(0 if polygons else 1, 1)))
    )
    return Fence(polygons, circles)


poses = st.tuples(places, places, st.floats(-math.pi, math.pi))


def body_points(pose, body=BODY):
    """Return points of the body in `world`, (n, 2)."""
    x, y = samples(body, 0.03).T
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y], -1)


def is_allowed(fence, point):
    """Say whether a point is where it may be: by the winding of rays, in plain numbers."""
    for polygon in fence.polygons:
        corners, inside = polygon.corners, False
        for (ax, ay), (bx, by) in zip(corners, (*corners[1:], corners[0]), strict=True):
            if (ay > point[1]) != (by > point[1]):
                inside ^= ax + (point[1] - ay) * (bx - ax) / (by - ay) > point[0]
        if inside != polygon.keeps_in:
            return False
    return all(
        (math.dist(point, each[:2]) < each.radius_m) == each.keeps_in for each in fence.circles
    )


def boundary(fence):
    """Return points of all outlines, (n, 2)."""
    found = []
    for polygon in fence.polygons:
        corners = np.array(polygon.corners)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            found.append(a + np.linspace(0.0, 1.0, 150)[:, np.newaxis] * (b - a))
    for circle in fence.circles:
        angles = np.linspace(0.0, math.tau, 400)
        found.append(
            np.array(circle[:2]) + circle.radius_m * np.stack([np.cos(angles), np.sin(angles)], 1)
        )
    return np.concatenate(found)


@settings(max_examples=40)
@given(fences(), poses, st.sampled_from([BODY, ARM, HOLLOW]))
def test_positive_is_the_distance_of_a_body_that_is_wholly_where_it_may_be(fence, pose, body):
    (clearance,) = body_clearance(fence, body, np.array([pose]))
    here = body_points(pose, body)
    outline = boundary(fence)
    away_m = np.hypot(*(here[:, np.newaxis] - outline).transpose(2, 0, 1)).min()
    if clearance > 0.0:
        assert all(is_allowed(fence, point) for point in here)
        assert away_m == pytest.approx(clearance, abs=0.05)
    elif away_m > 0.05:
        assert not all(is_allowed(fence, point) for point in here)


@settings(max_examples=40)
@given(st.lists(points, min_size=3, max_size=6), poses, bodies())
def test_the_distance_of_any_body_from_a_fence_is_what_shapely_says(corners, pose, body):
    fence = shapely.Polygon(corners)
    assume(fence.is_valid and fence.area > 0.1)
    shape = shapely.affinity.rotate(shape_of(body), pose[2], origin=(0, 0), use_radians=True)
    shape = shapely.affinity.translate(shape, *pose[:2])
    for keeps_in in (True, False):
        around = Fence((FencePolygon(tuple(corners), keeps_in),))
        (clearance,) = body_clearance(around, body, np.array([pose]))
        away = shape.distance(fence.exterior)
        allowed = fence.contains(shape) if keeps_in else fence.disjoint(shape)
        if away > 1e-6:
            assert (clearance > 0.0) == allowed
            if allowed:
                assert clearance == pytest.approx(away, abs=1e-6)
        else:
            assert clearance <= 1e-6


@settings(max_examples=40)
@given(fences(), poses, st.tuples(*[st.floats(-0.2, 0.2)] * 3), st.floats(0.0, 1.0))
def test_a_cap_cuts_and_poses_do_not_depend_on_each_other(fence, pose, step, cap_m):
    several = [tuple(np.add(pose, np.multiply(step, k))) for k in range(6)]
    together = body_clearance(fence, BODY, np.array(several), cap_m)
    alone = [body_clearance(fence, BODY, np.array([pose]))[0] for pose in several]
    assert together == pytest.approx(np.minimum(alone, cap_m))


@given(st.floats(0.01, 0.3), st.floats(-0.3, 0.3))
def test_a_body_that_sticks_out_is_the_farther_in_the_less_it_does(out_m, turn_rad):
    wall = Fence((FencePolygon(((-9.0, -9.0), (1.0, -9.0), (1.0, 9.0), (-9.0, 9.0)), True),))
    nose_m = max(
        0.2 * math.cos(turn_rad) - side * 0.18 * math.sin(turn_rad) for side in (1.0, -1.0)
    )
    pose = (1.0 - nose_m + out_m, 0.0, turn_rad)
    assert body_clearance(wall, BODY, np.array([pose]))[0] == pytest.approx(
        -out_m if pose[0] < 1.0 else -(BODY.reach_m + pose[0] - 1.0)
    )
