"""Exploring rooms of cells: what can be reached becomes known, and then it ends."""

import numpy as np
import pytest
from scipy import ndimage

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, Status
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.frontiers import frontiers
from tests.planning.behave.journey.bench import BODY, Bench, room, two_rooms


def explore(bench, seconds):
    """Explore; return how that ended."""
    behaviour = bench.pilot.exploration(0.6)
    while bench.now_ns < seconds * 1e9:
        bench.look()
        step = behaviour.step(BehaviourInput(bench.pose, bench.twist, (), ()), bench.now_ns)
        if step.status is not Status.RUNNING:
            return step
        bench.move(step.v_m_s, step.omega_rad_s)
    return None


@pytest.mark.parametrize("door_m", [0.8, 0.2])
def test_all_that_can_be_reached_is_known_in_the_end_and_a_narrow_door_is_not_tried(door_m):
    cells = two_rooms(door_m)
    cells[60:62, 85:120] = 100
    bench = Bench(cells)
    end = explore(bench, 120.0)
    assert end.status is Status.DONE
    assert end.text.startswith("the map is complete")
    space = bench.pilot.tools.world.map.space()
    rows, columns = np.nonzero(cells == 0)
    places = np.column_stack([columns + 0.5, rows + 0.5]) * 0.05
    known = space.grid.cells[tuple(space.grid.cell_of(places).T)] == 0
    first_room = places[:, 0] < 3.0
    assert known[first_room].mean() > 0.98
    if door_m > 0.5:
        assert known.mean() > 0.98
    else:
        assert bench.pose.x_m < 3.0


def test_a_frontier_lies_where_known_floor_ends_and_has_a_place_with_room_to_turn():
    cells = room()
    cells[1:-1, 80:] = -1
    space = PlanningMap(GridMap(cells, 0.05), Footprint(((0.2, -0.2), (0.2, 0.2), (-0.2, 0.0))),
                        through_unknown=True)  # fmt: skip
    (found,) = frontiers(space, (1.0, 2.0), 0.05)
    assert found.middle == pytest.approx((3.975, 2.0), abs=0.051)
    assert found.length_m == pytest.approx(4.0 - 2 * 0.05 - 2 * space.inscribed * 0.05, abs=0.16)
    here = space.to_cells(SE2(*found.place, 0.0))
    reach = np.hypot(*(np.array(found.place) - found.middle))
    assert reach < 1.0
    away = ndimage.distance_transform_edt(~space.blocked)[int(here.y_m), int(here.x_m)]
    assert away * 0.05 >= 0.28 + 0.05


def test_without_anything_unknown_there_is_no_frontier():
    space = PlanningMap(GridMap(room(), 0.05), Footprint(), through_unknown=True)
    assert frontiers(space, (1.0, 2.0), 0.05) == []


def test_a_frontier_behind_a_wall_counts_only_for_a_robot_there():
    cells = two_rooms(0.0)
    cells[1:-1, 100:] = -1
    space = PlanningMap(GridMap(cells, 0.05), Footprint(), through_unknown=True)
    assert frontiers(space, (1.0, 2.0), 0.05) == []
    assert len(frontiers(space, (4.0, 2.0), 0.05)) == 1


def test_the_place_of_a_frontier_is_on_the_robot_s_side_of_a_wall():
    """At the end of a corridor that is too narrow to turn in, the room next door is nearer."""
    cells = two_rooms(0.0)
    cells[[33, 46], 44:60] = 100
    cells[34:46, 57:60] = -1
    space = PlanningMap(GridMap(cells, 0.05), BODY, through_unknown=True)
    (found,) = frontiers(space, (1.0, 2.0), 0.1)
    assert found.middle[0] == pytest.approx(2.825, abs=0.051)
    assert found.place[0] < 2.9


def test_a_frontier_whose_path_comes_and_goes_is_given_up():
    """A gap in a wall that is open from afar and closed from near by."""
    open_cells, closed = two_rooms(0.8), two_rooms(0.0)
    bench = Bench(open_cells)
    look = bench.look

    def deceived():
        bench.world = closed if bench.pose.x_m > 2.0 else open_cells
        look()

    bench.look = deceived
    end = explore(bench, 240.0)
    assert end is not None
    assert end.status is Status.DONE
    assert bench.pose.x_m < 3.0
