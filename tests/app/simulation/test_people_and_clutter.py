"""Runs among people and clutter: repeatable, scored, and on no map of the robot's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_sim.world.walking.walker import RADIUS_M
from robotctl.app.scoring.journey_score import JourneyScore
from robotctl.app.scoring.score import StampedPose
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.room import goals, load_furnished
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.errors import ConfigError
from robotctl.maps.world import find_world
from robotctl.planning.behave.mission.mission_file import parse_mission
from tests.app.simulation.missions import PATROL, drive, without_computing_times

BOX = np.array([[0.2, 0.1], [-0.2, 0.1], [-0.2, -0.1], [0.2, -0.1]])


def test_a_run_among_them_repeats_and_differs_from_one_without() -> None:
    crowded = {"people": 3, "clutter": 3, "max_seconds": 4.0}
    first, second = (without_computing_times(drive(**crowded)) for _ in range(2))
    assert first == second
    assert first != without_computing_times(drive(max_seconds=4.0))
    assert first["collisions"] == 0


def test_a_run_among_people_of_all_manners_repeats_and_has_them_all() -> None:
    options = SimOptions(find_file("diff_drive"), PATROL, people=4, manner="mixed", max_seconds=2)
    walks = []
    for _ in range(2):
        run = LockstepRun(options)
        people = run.stack.simulation._people
        assert people is not None
        assert len({type(each).__name__ for each in people._people}) == 3  # two of them roam
        run.run()
        walks.append(people.places_m)
    assert walks[0] == walks[1]


@pytest.mark.parametrize(
    ("manner", "people", "said"),
    [
        ("evade", 2, 'allowed: stubborn, evades, wanders, runs.*did you mean "evades"'),
        ("runs", 0, "--manner runs: nobody walks about; add --people N"),
    ],
)
def test_manners_that_are_none_or_nobodys_are_refused(manner: str, people: int, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        SimOptions(find_file("diff_drive"), PATROL, people=people, manner=manner)


def test_the_robot_does_not_know_of_clutter() -> None:
    options = (SimOptions(find_file("diff_drive"), PATROL, clutter=count) for count in (4, 0))
    cluttered, plain = (LockstepRun(each).stack.simulation.world for each in options)
    assert len(cluttered.things) == len(plain.things) + 4
    assert np.array_equal(cluttered.segments, plain.segments)


def test_the_goals_of_a_mission_stay_clear() -> None:
    mission = parse_mission(
        'name = "m"\nworld = "flat"\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 0.0 }\n'
        '[[item]]\nkind = "goto"\nx_m = 6.0\ny_m = 3.0\n'
        '[[item]]\nkind = "wait"\nduration_s = 1.0\n',
        "m.toml",
    )
    assert goals(mission) == ((6.0, 3.0),)
    for seed in range(3):
        options = SimOptions(find_file("diff_drive"), PATROL, seed=seed, clutter=6)
        room = load_furnished(find_world("flat"), options, mission)
        for thing in room.things[-6:]:
            for place in ((6.0, 3.0), (1.0, 1.0)):
                assert np.hypot(*(thing.corners - place).T).min() > 0.6 - 1e-9


@pytest.mark.parametrize("heading_rad", [0.0, math.pi / 2])
def test_the_smallest_clearance_is_that_to_people_too(heading_rad: float) -> None:
    journey = JourneyScore([[BOX]], np.empty((0, 4)))
    gap_m = 2.0 - (0.2 if heading_rad == 0.0 else 0.1) - RADIUS_M
    journey.truth(StampedPose(0, 1.0, 1.0, heading_rad), [(3.0, 1.0), (9.0, 1.0)])
    assert journey.min_clearance_m == pytest.approx(gap_m)
