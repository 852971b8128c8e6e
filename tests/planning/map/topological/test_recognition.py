"""Scans are recognised as of the place where they were taken, and of no other."""

import numpy as np
import pytest

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.map.topological.graph import spot
from robotctl.planning.map.topological.recognition import PlaceSearch, appearances, look_of
from tests.planning.map.topological.little_world import (
    DOORS,
    ROOMS,
    corridors,
    little_world,
)


@pytest.fixture(scope="module")
def looks():
    return appearances(little_world().map)


def searched(scan, looks, world=None):
    topology = (world or little_world()).map
    return PlaceSearch(list(looks.values()), topology).suggest(look_of(scan))


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_is_recognised_from_anywhere_in_it_and_turned_anyhow(room, looks):
    rng = np.random.default_rng(1)
    low_x, low_y, high_x, high_y = ROOMS[room]
    world = little_world()
    for _ in range(3):
        x_m, y_m = rng.uniform((low_x + 0.9, low_y + 0.9), (high_x - 0.9, high_y - 0.9))
        truth = SE2(x_m, y_m, rng.uniform(-3.0, 3.0))
        found = searched(world.scan(truth, 1), looks).found
        assert found is not None
        assert found.place == room
        # Where its doors are seen from the robot is where they are.
        for out in world.map.place(room).exit:
            doors = [box for ends, box in DOORS.items() if room in ends]
            middles = [((box[0] + box[2]) / 2, (box[1] + box[3]) / 2) for box in doors]
            T_world_frame = truth @ found.pose.inverse()
            at = T_world_frame @ SE2(*spot(out))
            off_m = min(np.hypot(at.x_m - x, at.y_m - y) for x, y in middles)
            assert off_m < 0.25


def test_rooms_that_look_alike_are_both_named(looks):
    hall = looks["hall"]
    twin = appearances(little_world().map)["hall"]
    twin.name = "twin"
    scan = little_world().scan(SE2(3.0, 2.0, 0.4), 1)
    search = searched(scan, {"hall": hall, "twin": twin})
    assert search.found is None
    assert search.refusal in {
        "from here hall and twin look alike",
        "from here twin and hall look alike",
    }


@pytest.mark.parametrize("x_m", [4.3, 4.7, 5.1, 7.5, 7.9])
def test_beside_an_open_passage_either_place_will_do(x_m):
    """A corridor and the junction it leads to see the same, and agree where that is."""
    world = corridors()
    truth = SE2(x_m, 3.7, 2.0)
    search = searched(world.scan(truth, 1), appearances(world.map), world)
    assert search.found is not None, search.refusal
    side = "west" if x_m < 6.0 else "east"
    assert search.found.place in {side, "crossing"}
    passage = next(each for each in world.map.passages if set(each.between) == {side, "crossing"})
    out = world.map.place(search.found.place).way_out(passage.name)
    at = truth @ search.found.pose.inverse() @ out
    middle_x_m = 5.0 if side == "west" else 7.6  # a circle into all corners ends there
    assert (at.x_m, at.y_m) == pytest.approx((middle_x_m, 3.8), abs=0.4)


def test_a_round_hall_is_no_place_of_the_map(looks):
    angles = np.linspace(-np.pi, np.pi, 240, endpoint=False)
    search = searched(RangeScan(1, angles, np.full(240, 4.0), 12.0), looks)
    assert search.found is None
    assert search.refusal.startswith("this is no place of the map: ")
