"""Mission files: what is accepted, and what people read when something is wrong."""

import pytest

from robotctl.errors import ConfigError, MissionError
from robotctl.planning.behave.behaviours.follow_path import DriveItem
from robotctl.planning.behave.behaviours.follow_wall import FollowWallItem, Until
from robotctl.planning.behave.behaviours.kind import Abilities
from robotctl.planning.behave.behaviours.turn_to import TurnToItem
from robotctl.planning.behave.behaviours.wait import WaitItem
from robotctl.planning.behave.mission.check import check_mission, item_title
from robotctl.planning.behave.mission.mission_file import Mission, StartPose, parse_mission
from robotctl.planning.config import GuardConfig

BODY = GuardConfig().outline(())

TEXT = """
name = "demo"
world = "flat"
start = { x_m = 1.0, y_m = 2, heading_deg = 90.0 }

[[item]]
kind = "drive"
name = "out"
waypoints = [[1.0, 2.0], [1, 4], [3.0, 4.0]]
corner_radius_m = 0.6

[[item]]
kind = "follow_wall"
side = "left"
distance_m = 0.5
until = { length_m = 2.0, position = [4.0, 4.0] }

[[item]]
kind = "straight_to"
x_m = 1.0
y_m = 1.0

[[item]]
kind = "turn_to"
heading_deg = 180.0

[[item]]
kind = "wait"
duration_s = 2.5
"""
ALL = frozenset({"front", "left", "right", "rear"})


def test_every_kind_of_item_is_read_into_its_type():
    mission = parse_mission(TEXT, "demo.toml")
    assert [item.kind for item in mission.item] == [
        "drive",
        "follow_wall",
        "straight_to",
        "turn_to",
        "wait",
    ]
    assert mission.start.pose.y_m == 2.0
    drive, wall = mission.item[:2]
    assert isinstance(drive, DriveItem)
    assert drive.waypoints == ((1.0, 2.0), (1.0, 4.0), (3.0, 4.0))
    assert isinstance(wall, FollowWallItem)
    assert wall.until == Until(length_m=2.0, position=(4.0, 4.0))
    assert isinstance(mission.item[4], WaitItem)


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("corner_radius_m = 0.6", "corner_radus_m = 0.6", r"demo\.toml:10:.*corner_radius_m"),
        ('side = "left"', 'side = "lefd"', r"demo\.toml:14:.*left"),
        ("x_m = 1.0\ny_m = 1.0", "x_m = 1.0", r"y_m.*missing"),
        ("corner_radius_m = 0.6", "corner_radius_m = 3.0", r"demo\.toml:6:.*apart"),
        (
            "duration_s = 2.5",
            "duration_s = -1",
            r"duration_s: must be above 0.* not -1",
        ),
        ("duration_s = 2.5", "duration_s = 1e300", r"duration_s: .*at most 1000000, not 1e\+300"),
        ("distance_m = 0.5", "distance_m = 1e300", r"distance_m: .*at most 1000000, not 1e\+300"),
        ("length_m = 2.0", "length_m = inf", r"length_m: .*at most 1000000, not inf"),
        ("x_m = 1.0\ny_m = 1.0", "x_m = -1e300\ny_m = 1.0", r"x_m: .*-1000000 to 1000000"),
        ("[3.0, 4.0]]", "[3.0, 1e300]]", r"waypoints: .*-1000000 to 1000000, not \(3\.0, 1e"),
        ("[4.0, 4.0]", "[4.0, nan]", r"position: .*-1000000 to 1000000"),
        (
            "corner_radius_m = 0.6",
            "corner_radius_m = 1e300",
            r"toml:10: .*radius_m: must be 0 to 1",
        ),
        ("length_m = 2.0, position = [4.0, 4.0]", "", r"one of length_m, front_below_m"),
        ("heading_deg = 180.0", 'heading_deg = "west"', r"heading_deg"),
        ('kind = "wait"', 'kind = "sleep"', r"sleep"),
        ("kind = ", "kind ", r"not valid TOML"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line_and_what_is_allowed(right, wrong, message):
    assert right in TEXT
    with pytest.raises(ConfigError, match=message):
        parse_mission(TEXT.replace(right, wrong), "demo.toml")


def test_a_mission_without_items_is_refused():
    with pytest.raises(ConfigError, match="at least one"):
        parse_mission('name = "a"\nworld = "b"\nitem = []\nstart = {x_m = 0, y_m = 0}', "a.toml")


def test_all_wrong_keys_are_reported_at_once():
    text = TEXT.replace("duration_s", "duratoin_s").replace("distance_m", "distnace_m")
    with pytest.raises(ConfigError) as error:
        parse_mission(text, "demo.toml")
    assert "duratoin_s" in str(error.value)
    assert "distnace_m" in str(error.value)


def mission(*items):
    return Mission("demo", StartPose(0.0, 0.0), items)


def test_a_drive_and_steer_robot_refuses_to_turn_on_the_spot_and_names_the_item(steered):
    plan = mission(WaitItem("wait", 1.0), TurnToItem("turn_to", 90.0, "look north"))
    with pytest.raises(MissionError, match=r'item 2 "look north" \(turn_to\).*cannot turn'):
        check_mission(plan, Abilities(steered.drive, ALL, GuardConfig(), BODY))


def test_a_differential_drive_takes_corners_and_turns_of_any_kind(differential):
    plan = mission(
        TurnToItem("turn_to", 90.0), DriveItem("drive", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    )
    check_mission(plan, Abilities(differential.drive, ALL, GuardConfig(), BODY))


def test_corners_tighter_than_the_turning_radius_are_refused(steered):
    corner = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0))
    with pytest.raises(MissionError, match=r"corner_radius_m = 0\.3 is below the turning radius"):
        check_mission(
            mission(DriveItem("drive", corner, 0.3)),
            Abilities(steered.drive, ALL, GuardConfig(), BODY),
        )
    check_mission(
        mission(DriveItem("drive", corner, 0.6)), Abilities(steered.drive, ALL, GuardConfig(), BODY)
    )


def test_a_straight_path_of_many_points_needs_no_corner_radius(steered):
    straight = ((0.0, 0.0), (1.0, 0.0), (2.0, 0.1))
    check_mission(
        mission(DriveItem("drive", straight)), Abilities(steered.drive, ALL, GuardConfig(), BODY)
    )


def test_a_wall_on_a_side_without_sonar_is_refused(robot):
    wall = FollowWallItem("follow_wall", "right", 0.5, Until(front_below_m=0.5))
    with pytest.raises(MissionError, match="to the right") as error:
        check_mission(
            mission(wall), Abilities(robot.drive, frozenset({"left"}), GuardConfig(), BODY)
        )
    assert "to the front" in str(error.value)


@pytest.mark.parametrize("front_m", [0.05, 0.12])
def test_a_front_distance_that_the_guard_never_lets_the_robot_reach_is_refused(robot, front_m):
    wall = FollowWallItem("follow_wall", "left", 0.5, Until(front_below_m=front_m))
    with pytest.raises(MissionError, match=rf"front_below_m = {front_m} .*stops 0\.12 m before"):
        check_mission(mission(wall), Abilities(robot.drive, ALL, GuardConfig(), BODY))
    check_mission(
        mission(wall), Abilities(robot.drive, ALL, GuardConfig(margin_m=0.99 * front_m), BODY)
    )


def test_an_item_without_name_is_called_by_its_number_and_kind():
    assert item_title(mission(WaitItem("wait", 1.0)), 0) == "item 1 (wait)"


def test_a_wall_nearer_than_half_of_the_robots_width_is_refused(robot):
    wall = FollowWallItem("follow_wall", "left", 0.17, Until(length_m=1.0))
    with pytest.raises(MissionError, match=r"distance_m = 0.17 .* its side would touch; 0.18"):
        check_mission(mission(wall), Abilities(robot.drive, ALL, GuardConfig(), BODY))
    narrow = GuardConfig(half_width_m=0.17)
    check_mission(mission(wall), Abilities(robot.drive, ALL, narrow, narrow.outline(())))
