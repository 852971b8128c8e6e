"""Fields of a recording over time: found by their names, with gaps where nothing was logged."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from robotctl.logs.mcap.entries import Published
from robotctl.logs.mcap.log import McapLog
from robotctl.messages.control import ControlState, LoopStatistics, SafetyState
from robotctl.workbench.logs.rows import RecordingError
from robotctl.workbench.logs.series import Selection, Series, Stretch, select
from tests.mavlink.conftest import CONTROL, NAVIGATION

PERIOD_NS = 20_000_000


def state(at_s: float, ticks: int, **changes: object) -> ControlState:
    return msgspec.structs.replace(
        CONTROL, stamp_ns=round(at_s * 1e9), loop=LoopStatistics(ticks=ticks), **changes
    )


def drive(begin_s: float, end_s: float, ticks: int, **changes: object) -> list[ControlState]:
    """The states of a robot that drives 0.1 m/s for each second of the log."""
    count = round((end_s - begin_s) * 50)
    times_s = [begin_s + 0.02 * index for index in range(count)]
    return [
        state(at_s, ticks + index, v_m_s=0.1 * at_s, **changes)
        for index, at_s in enumerate(times_s)
    ]


def write_log(path: Path, *messages: Published) -> None:
    with path.open("wb") as file:
        log = McapLog(file, 10**18, "rover")
        for message in messages:
            log.add(message)
        log.close()


def selected(run: Path, *fields: str) -> Selection:
    return select(run, fields, lambda done, total: None)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run whose control was killed after 2 s, began anew 3 s later, and ended in a fault."""
    standby = {"state": SafetyState.STANDBY}
    driving = {"state": SafetyState.DRIVING, "distance_m": 1.0}
    write_log(
        tmp_path / "robot-0001.mcap",
        NAVIGATION,
        *drive(0.0, 0.5, 100, **standby),
        *drive(0.5, 2.0, 125, **driving),
        *drive(5.0, 6.0, 1, **standby),
    )
    fault = {"state": SafetyState.FAULT}
    write_log(tmp_path / "robot-0002.mcap", *drive(6.0, 7.0, 51, **fault))
    return tmp_path


def shown(series: Series, at_s: float) -> float:
    """Return what a line through the points of a series shows; nan in a gap."""
    after = int(np.searchsorted(series.time_s, at_s))
    around = series.values[after - 1 : after + 1]
    return float(np.interp(at_s, series.time_s[after - 1 : after + 1], around))


def test_a_gap_is_a_gap(run: Path) -> None:
    (speed,) = selected(run, "control.v_m_s").series
    assert speed.messages == 200
    assert (speed.name, speed.unit) == ("control.v_m_s", "m/s")
    assert speed.gaps == (pytest.approx((1.98, 5.0)),)
    assert shown(speed, 1.5) == pytest.approx(0.15)
    assert math.isnan(shown(speed, 3.0))
    assert shown(speed, 5.5) == pytest.approx(0.55)
    assert shown(speed, 5.99) == pytest.approx(0.599)  # from file to file there is none


def test_the_states_of_the_robot_go_on_up_to_the_gap_and_from_its_end(run: Path) -> None:
    selection = selected(run, "control.v_m_s")
    expected = [
        Stretch(SafetyState.STANDBY, 0.0, 0.5),
        Stretch(SafetyState.DRIVING, 0.5, 1.98),
        Stretch(SafetyState.STANDBY, 5.0, 6.0),
        Stretch(SafetyState.FAULT, 6.0, 6.98),
    ]
    assert [each.state for each in selection.stretches] == [each.state for each in expected]
    for found, wanted in zip(selection.stretches, expected, strict=True):
        assert (found.begin_s, found.end_s) == pytest.approx((wanted.begin_s, wanted.end_s))
    assert selection.restarts_s == pytest.approx([5.0])


def test_a_restart_without_a_pause_breaks_the_line_too(tmp_path: Path) -> None:
    write_log(tmp_path / "robot-0001.mcap", *drive(0.0, 1.0, 100), *drive(1.0, 2.0, 1))
    selection = selected(tmp_path, "control.v_m_s")
    assert selection.restarts_s == pytest.approx([1.0])
    (speed,) = selection.series
    assert np.isnan(speed.values).sum() == 1
    assert speed.time_s[np.isnan(speed.values)] == pytest.approx([1.0])


def test_a_second_run_in_the_same_folder_begins_a_line_of_its_own(tmp_path: Path) -> None:
    for number in (1, 2):
        write_log(tmp_path / f"robot-000{number}.mcap", *drive(0.0, 1.0, 1))
    (speed,) = selected(tmp_path, "control.v_m_s").series
    assert np.flatnonzero(np.isnan(speed.values)).tolist() == [50]


def test_what_a_message_lacks_is_missing_and_what_is_infinite_stays_so(tmp_path: Path) -> None:
    write_log(
        tmp_path / "robot-0001.mcap",
        state(0.0, 1, v_m_s=math.nan),
        state(0.02, 2, v_m_s=1.0, sonar_m=(math.inf, *CONTROL.sonar_m[1:])),
    )
    speed, range_m = selected(tmp_path, "control.v_m_s", "control.sonars[0].range_m").series
    np.testing.assert_array_equal(speed.values, [math.nan, 1.0])
    np.testing.assert_array_equal(range_m.values, [1.0, math.inf])


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("control.duty[1]", ["control.duty[1]"]),
        ("control.duty.1", ["control.duty[1]"]),
        ("control.duty", ["control.duty[0]", "control.duty[1]"]),
        ("control.T_odom_base", [f"control.T_odom_base.{e}" for e in ("x_m", "y_m", "theta_rad")]),
        ("control.sonars.2", ["control.sonars[2].range_m"]),
        ("T_world_base.pose.position.x", ["T_world_base.pose.position.x"]),
    ],
)
def test_fields_are_found_by_brackets_by_dots_and_by_what_they_are_in(
    run: Path, name: str, found: list[str]
) -> None:
    assert [each.name for each in selected(run, name).series] == found


def test_the_same_field_asked_for_twice_is_there_once(run: Path) -> None:
    names = [each.name for each in selected(run, "control.duty", "control.duty[0]").series]
    assert names == ["control.duty[0]", "control.duty[1]"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "contrl.v_m_s",
            "no topic 'contrl' in .*, did you mean \"control\".*there are T_world_base",
        ),
        ("control.v_ms", 'no such field in .*, did you mean "control.v_m_s".*; control has'),
        ("control.x_m", 'did you mean "control.T_odom_base.x_m"'),
        ("control.sonars.22.range_m", r'did you mean "control.sonars\[2\].range_m"'),
        ("control.reason", "is text, which has no plot"),
    ],
)
def test_a_wrong_name_is_answered_by_the_nearest(run: Path, name: str, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        selected(run, name)


def test_an_empty_log_says_so(tmp_path: Path) -> None:
    write_log(tmp_path / "robot-0001.mcap")
    with pytest.raises(RecordingError, match="nothing is in it"):
        selected(tmp_path, "control.v_m_s")
