"""Polylines: lengths, projection, rounding."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.planning.path.local.path import Path, rounded

L = Path([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0)])
coordinates = st.tuples(st.floats(-3, 3), st.floats(-3, 3))


def test_lengths_and_points_run_along_the_segments():
    assert L.length_m == 3.0
    assert L.point_at(0.5) == (0.5, 0.0)
    assert L.point_at(2.25) == (2.0, 0.25)
    assert L.turn_rad(1) == pytest.approx(math.pi / 2)


def test_beyond_its_ends_a_path_goes_on_straight():
    assert L.point_at(3.5) == (2.0, 1.5)
    assert L.point_at(-0.5) == (-0.5, 0.0)


@given(coordinates)
def test_the_projection_is_the_nearest_of_many_sampled_points(point):
    nearest = L.project(*point, 0.0, L.length_m)
    sampled = min(math.dist(point, L.point_at(3.0 * i / 3000)) for i in range(3001))
    assert nearest.distance_m == pytest.approx(sampled, abs=2e-3)
    assert math.dist(point, L.point_at(nearest.s_m)) == pytest.approx(nearest.distance_m, abs=1e-6)


def test_the_window_keeps_apart_pieces_that_pass_the_same_place():
    crossing = Path([(0, 0), (4, 0), (4, 2), (2, 2), (2, -2)])
    assert crossing.project(2.0, 0.01, 0.0, 3.0).s_m == pytest.approx(2.0)
    assert crossing.project(2.0, 0.01, 7.0, 11.0).s_m == pytest.approx(9.99)


def test_a_projection_never_leaves_its_window():
    assert L.project(0.0, 0.0, 1.2, 2.5).s_m == 1.2
    assert L.project(2.0, 9.0, 0.0, 2.5).s_m == 2.5


def test_on_a_way_there_and_back_the_earlier_place_counts():
    back = Path([(0, 0), (2, 0), (0, 0)])
    assert back.project(1.9, 0.1, 1.5, 3.0).s_m == pytest.approx(1.9)


@given(st.floats(0.1, 1.0), st.floats(-2.5, 2.5).filter(lambda a: abs(a) > 0.05))
def test_a_rounded_corner_is_an_arc_of_its_radius_tangent_to_both_sides(radius, angle):
    end = (5.0 + 5.0 * math.cos(angle), 5.0 * math.sin(angle))
    path = rounded([(0.0, 0.0), (5.0, 0.0), end], radius)
    tangent = radius * math.tan(abs(angle) / 2)
    centre = (5.0 - tangent, math.copysign(radius, angle))
    assert path[1] == pytest.approx((5.0 - tangent, 0.0))
    for point in path[1:-1]:
        assert math.dist(point, centre) == pytest.approx(radius)
    assert math.dist(path[-2], (5.0, 0.0)) == pytest.approx(tangent)
    assert Path(path).turn_rad(len(path) - 2) < math.radians(8)


def test_a_rounded_path_keeps_its_ends_and_its_collinear_points():
    points = [(0.0, 0.0), (1.0, 0.0), (3.0, 0.0)]
    path = rounded(points, 0.5)
    assert (path[0], path[-1]) == (points[0], points[-1])
    assert Path(path).length_m == pytest.approx(3.0)


def test_corners_that_do_not_fit_are_refused_with_the_place_and_the_length():
    with pytest.raises(ValueError, match=r"need 1\.40 m between the points \(1, 0\) and \(1, 1\)"):
        rounded([(0, 0), (1, 0), (1, 1), (0, 1)], 0.7)


def test_a_corner_straight_back_cannot_be_rounded():
    with pytest.raises(ValueError, match="straight back at"):
        rounded([(0, 0), (1, 0), (0, 0)], 0.2)


@pytest.mark.parametrize("points", [[], [(1.0, 1.0)], [(1.0, 1.0), (1.0, 1.0)]])
def test_fewer_than_two_different_points_are_no_path(points):
    with pytest.raises(ValueError, match="two different points"):
        Path(points)


def test_a_point_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="finite"):
        Path([(0.0, 0.0), (math.nan, 1.0)])
