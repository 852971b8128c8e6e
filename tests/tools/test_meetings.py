"""Meetings in a corridor: whom a robot can pass there, and whom not."""

import pytest

from firmware_sim.world.world import load_world
from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.plan import plan
from tools.case_file import write_cases
from tools.meetings import HALF_M, world, write

PERSON_M = 0.22
BODY_M = 0.36


@pytest.mark.parametrize("kind", ["head-on", "behind"])
@pytest.mark.parametrize(("lane", "fits"), [("middle", False), ("side", True)])
@pytest.mark.parametrize("number", range(5))
def test_there_is_room_beside_who_walks_along_a_wall_and_none_in_the_middle(
    number, kind, lane, fits
):
    person = world(number, kind, lane, niche=False)["person"][0]
    (_, y_m), (_, ends_y_m) = person["points"]
    assert y_m == ends_y_m
    assert abs(y_m) + PERSON_M < HALF_M
    assert (HALF_M + abs(y_m) - PERSON_M > BODY_M) == fits


def test_they_are_runs_of_a_campaign_in_worlds_that_can_be_loaded(tmp_path):
    file = tmp_path / "meetings.toml"
    write_cases(file, [write(tmp_path, number, 1) for number in (0, 5)])
    runs = plan(load_campaign(file, lambda _: ""))
    assert [run.factors["robot"] for run in runs] == ["diff_drive", "ackermann"]
    for number in (0, 5):
        loaded = load_world(tmp_path / f"meeting_{number:03d}_world.toml")
        assert loaded.people[0].speed_m_s < 1.3
