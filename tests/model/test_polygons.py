"""Bodies of any polygons, against shapely: their pieces, sides, points and circles."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import discs, inner_samples, samples
from robotctl.model.polygons import is_convex, sides_of
from tests.model.polygon_bodies import bodies, shape_of

places = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))

U = (
    (0.3, -0.3), (0.3, -0.1), (0.1, -0.1), (0.1, 0.1), (0.3, 0.1), (0.3, 0.3), (-0.3, 0.3),
    (-0.3, -0.3),
)  # fmt: skip
"""A robot with a jaw at each side of its front."""


@given(bodies())
def test_the_pieces_are_convex_and_cover_the_same_floor_and_no_other(body):
    pieces = [shapely.Polygon(piece) for piece in body.pieces]
    assert all(is_convex(piece) and piece for piece in body.pieces)
    whole = shapely.union_all([piece.buffer(1e-9) for piece in pieces])
    assert whole.symmetric_difference(shape_of(body)).area < 1e-6
    if not body.parts:
        assert sum(piece.area for piece in pieces) == pytest.approx(whole.area, abs=1e-6)


@given(bodies(most_parts=0))
def test_there_are_at_most_four_times_as_many_pieces_as_it_needs(body):
    sides = sides_of(body.corners)
    turns = [
        (b[0] - a[0]) * (d[1] - c[1]) - (b[1] - a[1]) * (d[0] - c[0])
        for (a, b), (c, d) in zip(sides, [*sides[1:], sides[0]], strict=True)
    ]
    hollow = sum(each < 0.0 for each in turns)
    assert len(body.pieces) <= max(1, 2 * hollow + 1)


@given(bodies(), places)
def test_a_point_is_in_the_body_where_shapely_says_so(body, place):
    shape, point = shape_of(body), shapely.Point(place)
    depth_m = body.depth_m(*place)
    if shape.boundary.distance(point) > 1e-6 and abs(depth_m) > 1e-9:
        assert (depth_m > 0.0) == shape.contains(point)
    if depth_m < 0.0:  # never farther than it is, and at a corner not much nearer
        assert -depth_m <= shape.distance(point) + 1e-9


@given(bodies())
def test_the_open_sides_are_the_boundary(body):
    boundary = shape_of(body).boundary
    lines = shapely.union_all([shapely.LineString(side) for side in body.open_sides])
    assert lines.length == pytest.approx(boundary.length, abs=2e-3)
    assert shapely.hausdorff_distance(lines, boundary, densify=0.05) < 2e-3
    assert body.inscribed_m == pytest.approx(boundary.distance(shapely.Point(0.0, 0.0)), abs=1e-5)


@given(bodies(), st.floats(0.02, 0.2))
def test_points_of_the_body_lie_in_it_and_leave_no_hole_and_circles_cover_it(body, spacing_m):
    shape, points = shape_of(body), samples(body, spacing_m)
    assert shapely.distance(shape, shapely.points(points)).max() < 1e-6
    low, high = np.array(body.points).min(axis=0), np.array(body.points).max(axis=0)
    asked = np.random.default_rng(1).uniform(low, high, (200, 2))
    asked = asked[shapely.contains(shape, shapely.points(asked))]
    if len(asked):
        away = np.hypot(*(asked[:, np.newaxis] - points).transpose(2, 0, 1)).min(axis=1)
        assert away.max() <= spacing_m
        covering = discs(body)
        apart = np.hypot(*(asked[:, np.newaxis] - covering[:, :2]).transpose(2, 0, 1))
        assert (apart <= covering[:, 2] + 1e-9).any(axis=1).all()


@given(bodies(), st.floats(0.01, 0.1))
def test_inner_points_lie_in_the_body(body, inwards_m):
    points = inner_samples(body, 0.02, inwards_m)
    assert len(points) > 0
    assert shapely.distance(shape_of(body), shapely.points(points)).max() < 1e-6


def test_inner_points_keep_off_the_boundary_as_far_as_a_thin_piece_allows():
    arm = Footprint.rectangle(-0.3, 0.3, 0.3).corners
    body = Footprint(arm, (((0.0, -0.3), (0.0, -0.9), (0.04, -0.9), (0.04, -0.3)),))
    points = inner_samples(body, 0.02, 0.1)
    depths = shapely.distance(shape_of(body).boundary, shapely.points(points))
    in_arm = points[:, 1] < -0.25
    assert depths[~in_arm].min() >= 0.1 - 1e-6
    assert depths[in_arm].min() == pytest.approx(0.02)


def test_a_robot_with_jaws_has_a_gap_between_them():
    body = Footprint(U)
    assert body.depth_m(0.2, 0.0) == pytest.approx(-0.1)
    assert body.depth_m(0.2, 0.2) == pytest.approx(0.1)
    assert body.inscribed_m == pytest.approx(0.1)
    assert body.reach_m == pytest.approx(math.hypot(0.3, 0.3))


def test_a_part_beside_the_outline_counts_and_one_within_it_changes_nothing():
    square = Footprint.rectangle(-0.2, 0.2, 0.2)
    beside = Footprint(square.corners, (((0.5, 0.1), (0.6, 0.1), (0.6, 0.2), (0.5, 0.2)),))
    assert beside.depth_m(0.55, 0.15) == pytest.approx(0.05)
    assert beside.depth_m(0.35, 0.15) == pytest.approx(-0.15)
    assert (beside.front_m, beside.inscribed_m) == (0.6, pytest.approx(0.2))
    within = Footprint(square.corners, (((0.0, 0.0), (0.1, 0.0), (0.1, 0.1)),))
    assert sorted(within.open_sides) == sorted(square.open_sides)
    grown = Footprint(square.corners, (((0.1, -0.2), (0.4, -0.2), (0.4, 0.2), (0.1, 0.2)),))
    assert grown.inscribed_m == pytest.approx(0.2)


@pytest.mark.parametrize(
    "corners",
    [
        ((0.1, 0.0), (0.2, 0.0), (0.3, 1e-12)),
        ((0.1, 0.0), (0.2, 1e-12), (0.3, 0.0), (0.2, 2e-12)),
    ],
)
def test_a_part_without_area_is_refused(corners):
    with pytest.raises(ValueError, match="outline"):
        Footprint(Footprint.rectangle(-0.2, 0.2, 0.2).corners, (corners,))
