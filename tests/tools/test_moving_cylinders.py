"""Fields of moving cylinders: from edge to edge along polynomials, none near the robot at first."""

import math

import numpy as np
import pytest

from firmware_sim.world.world import load_world
from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.plan import plan
from tools.case_file import write_cases
from tools.moving_cylinders import AWAY_M, ENDS_M, HALF_M, LEVELS, way, world, write


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_way_is_a_part_of_a_polynomial_from_edge_to_edge(order):
    rng = np.random.default_rng(order)
    for _ in range(20):
        x, y = way(rng, order).T
        assert np.abs([x, y]).max() <= HALF_M
        fitted = np.polynomial.Polynomial.fit(x, y, order)
        np.testing.assert_allclose(fitted(x), y, atol=1e-6)


@pytest.mark.parametrize("number", range(6))
def test_a_world_has_as_many_and_as_fast_ones_as_its_level_says(tmp_path, number):
    case = write(tmp_path, number, "jackal")
    (least, most), (slowest, fastest), _ = LEVELS[case["name"]]
    people = load_world(tmp_path / f"cylinders_{number:03d}_world.toml").people
    assert least <= len(people) < most
    assert all(slowest <= each.speed_m_s <= fastest for each in people)
    assert all(math.dist(each.points[0], (0.0, -ENDS_M)) > AWAY_M for each in people)


def test_worlds_are_those_of_their_number_and_runs_of_a_campaign(tmp_path):
    assert world(4, "hard") == world(4, "hard") != world(5, "hard")
    file = tmp_path / "cylinders.toml"
    write_cases(file, [write(tmp_path, number, "jackal") for number in (0, 5)])
    runs = plan(load_campaign(file, lambda _: ""))
    assert [run.factors["case"] for run in runs] == ["easy", "hard"]
