"""Bodies of any polygons among cells and people, as controllers and planners see them."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.grid_map import OCCUPIED, GridMap
from robotctl.planning.map.planning_map import PlanningMap, clearance_of
from robotctl.planning.path.local.body import SPACING, TOUCH, gap, gap_to_moving, make_body
from robotctl.planning.path.local.escape import intrusions, separation
from tests.model.polygon_bodies import bodies, shape_of

SIDE_M = 0.05
MIDDLE = 30.0
ARM = Footprint(
    ((0.25, -0.5), (0.25, 0.17), (-0.2, 0.17), (-0.2, -0.17), (0.1, -0.17), (0.1, -0.5))
)
several = bodies().filter(lambda body: not body.is_convex)
headings = st.floats(-math.pi, math.pi)


def shape_at(body, heading):
    """Return a body in cells about the middle of the map."""
    scaled = shapely.affinity.scale(shape_of(body), 1.0 / SIDE_M, 1.0 / SIDE_M, origin=(0.0, 0.0))
    turned = shapely.affinity.rotate(scaled, heading, origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, MIDDLE, MIDDLE)


def grid_of(blocked):
    cells = np.zeros((60, 60), np.bool_)
    for row, column in blocked:
        cells[row, column] = True
    return cells


@given(several, st.floats(0.005, 0.15))
def test_a_grown_body_holds_all_within_its_margin_and_little_more(body, margin_m):
    grown = make_body(body, margin_m, 1.0)
    loops = np.split(grown.outline[:, :2], np.unique(grown.outline[:, 2]).astype(int)[:-1])
    floor = shapely.union_all([shapely.Polygon(each).buffer(1e-9) for each in loops])
    shape = shape_of(body)
    assert shape.buffer(margin_m).difference(floor.buffer(1e-6)).is_empty
    assert floor.difference(shape.buffer(math.sqrt(2.0) * margin_m + 1e-3)).area < 1e-6
    assert grown.reach == pytest.approx(np.hypot(*grown.outline[:, :2].T).max())


@given(several, headings, st.lists(st.tuples(st.integers(12, 47), st.integers(12, 47)), max_size=9))
def test_a_body_touches_the_cells_that_it_reaches_into(body, heading, blocked):
    shape, cells = shape_at(body, heading), grid_of(blocked)
    boxes = [shapely.box(column, row, column + 1.0, row + 1.0) for row, column in blocked]
    apart = min((shape.distance(box) for box in boxes), default=math.inf)
    c, s = math.cos(heading), math.sin(heading)
    bare = make_body(body, 0.0, SIDE_M)
    near = gap(clearance_of(cells), bare.outline, SPACING, bare.discs, MIDDLE, MIDDLE, c, s)
    hits = PlanningMap(
        GridMap(np.where(cells, OCCUPIED, 0).astype(np.int8), SIDE_M), body
    ).collides(np.array([[MIDDLE, MIDDLE, heading]]))[0]
    if apart > 1e-6:
        assert near != TOUCH
        assert not hits
        assert near <= apart + 1.5
    elif any(shape.buffer(-1.0).intersects(box) for box in boxes):
        assert hits
        assert near == TOUCH or all(shape.contains(box) for box in boxes if box.intersects(shape))


@given(several, headings, st.lists(st.tuples(st.integers(12, 47), st.integers(12, 47)), max_size=9))
def test_cells_are_kept_apart_by_an_axis_only_where_the_body_is_apart(body, heading, blocked):
    shape, cells = shape_at(body, heading), grid_of(blocked)
    boxes = [shapely.box(column, row, column + 1.0, row + 1.0) for row, column in blocked]
    apart = min((shape.distance(box) for box in boxes), default=math.inf)
    found = separation(
        cells, make_body(body, 0.0, SIDE_M), MIDDLE, MIDDLE, math.cos(heading), math.sin(heading)
    )
    assert found <= min(apart, 2.0) + 1e-6
    if apart > 1e-6:
        assert found > -1e-6
    elif any(shape.intersection(box).area > 1e-6 for box in boxes):
        assert found < 1e-6


@given(several, headings, st.floats(0.0, 60.0), st.floats(0.0, 60.0))
def test_who_walks_is_never_nearer_than_the_gap_says(body, heading, x, y):
    person = np.array([[x, y, 0.0, 0.0, 2.0]])
    sides = make_body(body, 0.0, SIDE_M).sides
    c, s = math.cos(heading), math.sin(heading)
    found = gap_to_moving(person, sides, MIDDLE, MIDDLE, c, s, 0.0)
    apart = shape_at(body, heading).distance(shapely.Point(x, y))
    assert found <= apart - 2.0 + 1e-6
    if apart > 1e-6:
        assert found > -2.0 - 1e-6


@given(several, headings, st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_a_body_that_is_drawn_in_leaves_out_the_cell_that_reached_into_it(body, heading, x, y):
    row, column = math.floor(MIDDLE + y / SIDE_M), math.floor(MIDDLE + x / SIDE_M)
    cells = grid_of([(row, column)])
    bare = make_body(body, 0.0, SIDE_M)
    depths = intrusions(cells, bare, (MIDDLE, MIDDLE, heading), 2.0)
    try:
        left = make_body(body, (np.where(depths > 0.0, -depths, 0.0) * SIDE_M).tolist(), SIDE_M)
    except ValueError:
        return  # nothing is left round `base`
    c, s = math.cos(heading), math.sin(heading)
    assert separation(cells, left, MIDDLE, MIDDLE, c, s) > -1e-6


def test_the_gap_between_arm_and_body_is_free():
    cells = grid_of([(row, column) for row in (24, 25) for column in (27, 28, 29)])
    c, s = 1.0, 0.0
    bare = make_body(ARM, 0.0, SIDE_M)
    clearance = clearance_of(cells)
    assert gap(clearance, bare.outline, SPACING, bare.discs, MIDDLE, MIDDLE, c, s) != TOUCH
    hull = make_body(
        Footprint(((0.25, -0.5), (0.25, 0.17), (-0.2, 0.17), (-0.2, -0.17), (0.1, -0.5))),
        0.0, SIDE_M,
    )  # fmt: skip
    assert gap(clearance, hull.outline, SPACING, hull.discs, MIDDLE, MIDDLE, c, s) == TOUCH


def test_margins_that_leave_nothing_round_base_are_refused():
    with pytest.raises(ValueError, match="no body around base"):
        make_body(ARM, -0.3, SIDE_M)
