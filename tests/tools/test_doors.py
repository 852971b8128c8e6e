"""Doors that hardly leave room: as wide as they say, and runs of a campaign."""

import pytest
import shapely

from firmware_sim.world.world import load_world
from robotctl.config.robot_file import find_file, load_robot
from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.plan import plan
from tools.case_file import write_cases
from tools.doors import KINDS, write


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("drive", ["diff_drive", "tricycle", "ackermann"])
def test_a_door_is_wider_than_the_body_by_what_its_kind_says(tmp_path, number, drive):
    _, extra_m, _ = kind = KINDS[number]
    write(tmp_path, number, kind, drive)
    world = load_world(tmp_path / f"door_{number:03d}_world.toml")
    walls = shapely.MultiLineString([((a, b), (c, d)) for a, b, c, d in world.segments.tolist()])
    rooms = shapely.polygonize([*shapely.unary_union(walls).geoms]).geoms[0]
    footprint = load_robot(find_file(drive)).footprint
    body_m = footprint.left_m + footprint.right_m
    room_m = 0.5 * (body_m + extra_m)
    assert isinstance(rooms.buffer(0.01 - room_m), shapely.Polygon), "a little less passes"
    assert isinstance(rooms.buffer(-0.01 - room_m), shapely.MultiPolygon), "a little more does not"


def test_they_are_runs_of_a_campaign(tmp_path):
    file = tmp_path / "doors.toml"
    write_cases(file, [write(tmp_path, number, KINDS[-1], "tricycle") for number in (0, 5)])
    runs = plan(load_campaign(file, lambda _: ""))
    assert [run.factors["robot"] for run in runs] == ["tricycle", "tricycle"]
    assert [run.factors["case"] for run in runs] == ["sonar, +0.10 m, cells of 0.05 m"] * 2
