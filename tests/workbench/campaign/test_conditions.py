import json

import pytest

from robotctl.app.scoring.score import PoseError, Report, bus_report, loop_report
from robotctl.messages.control import BusStatus, LoopStatistics
from robotctl.workbench.campaign.conditions import (
    parse_condition,
    read_report,
    report_fields,
    value_of,
    violations,
)

REPORT = Report(
    robot="r",
    world="w",
    mission="m",
    seed=3,
    bus_kind="lockstep",
    mission_completed=True,
    message="",
    ended="",
    items_done=1,
    items=1,
    duration_s=5.0,
    distance_m=2.0,
    collisions=0,
    unsafe_motions=0,
    unsafe_reason="",
    pose_error=PoseError(0.1, 0.2, 0.0, 0.0, 0.0),
    loop=loop_report(LoopStatistics()),
    bus=bus_report(BusStatus()),
    real_time_factor=8.0,
)


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("mission_completed = true", True),
        ("mission_completed = false", False),
        ("collisions = 0", True),
        ("collisions != 0", False),
        ("pose_error.rmse_m <= 0.1", True),
        ("pose_error.rmse_m < 0.1", False),
        ("pose_error.max_m>0.1", True),
        ("bus.load >= 0", True),
        ("loop.lag_us.p99 = 0", True),
        ('robot = "r"', True),
        ("robot = r", True),
        ("localisation.error.rmse_m <= 1", False),  # the robot has no localiser
    ],
)
def test_a_condition_holds_or_says_what_was_found(text, holds):
    found = violations([parse_condition(text)], read_report(REPORT.json()))
    assert (not found) is holds
    assert all(text.split()[0].split(">")[0] in each for each in found)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("completed = true", 'did you mean "mission_completed"'),
        ("localisation.rmse_m <= 0.1", 'did you mean "localisation.error.rmse_m"'),
        ("collisions = none", "a number, found none"),
        ("collisions = true", "a number, found true"),
        ("mission_completed = 1", "true or false, found 1"),
        ("mission_completed > true", "has no order"),
        ("collisions", 'must be like "collisions = 0"'),
        ("loop.step_us.p99 < 100", "measures this computer"),
        ("real_time_factor > 1", "measures this computer"),
    ],
)
def test_what_is_no_condition_is_refused_with_the_reason(text, said):
    with pytest.raises(ValueError, match=r"\w") as refused:
        parse_condition(text)
    assert said in str(refused.value)


def test_every_field_that_can_be_named_is_one_of_a_report_or_of_a_part_it_may_lack():
    report = json.loads(REPORT.json())
    for name in report_fields():
        head = name.split(".")[0]
        assert report[head] is None or value_of(report, name) is not None or "." not in name


def test_two_runs_of_one_seed_on_a_fast_and_a_slow_computer_have_the_same_report():
    slow = json.loads(REPORT.json())
    slow["real_time_factor"] = 0.1
    slow["loop"]["step_us"]["p99"] = 99.0
    slow["loop"]["stage_us"]["p50"] = {"control": 3.0}
    assert read_report(json.dumps(slow).encode()) == read_report(REPORT.json())
