"""What survives restarts: odometer, pose within a run, and the mission item, resumed on purpose."""

import math
import zlib
from pathlib import Path

import msgspec
import pytest

from robotctl.app.processes import navigation as navigation_process
from robotctl.app.processes.control import continued
from robotctl.app.processes.navigation import resume
from robotctl.app.processes.navigator import make_navigation
from robotctl.app.processes.progress import (
    ProgressKeeper,
    StoredProgress,
    last_pose,
    load_progress,
    mission_crc,
    progress_file,
    resumed,
    state_directory,
)
from robotctl.app.processes.robot import make_core
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.control import (
    ControlState,
    LoopStatistics,
    Mode,
    NavigationState,
    SafetyState,
    SetHome,
    SetMode,
)
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.mission import JumpToItem, LoadMission
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.storage.state_file import StateError

SECOND_NS = 1_000_000_000
CONFIG = load_robot(find_file("diff_drive"))
MISSION = """
name = "out and back"
world = "flat"
start = { x_m = 1.0, y_m = 1.0 }
[[item]]
kind = "wait"
duration_s = 0.1
[[item]]
kind = "drive"
waypoints = [[1.0, 1.0], [9.0, 1.0]]
[[item]]
kind = "wait"
duration_s = 1.0
"""
ROUNDS = """
[[item]]
kind = "repeat"
name = "again"
times = 2
"""
BLANK = msgspec.structs.replace(
    make_core(CONFIG, StackOptions("x", "")).snapshot(0, LoopStatistics()),
    v_m_s=0.0,
    omega_rad_s=0.0,
    vy_m_s=0.0,
)
NAVIGATION = NavigationState(0, Mode.AUTO, "out and back", 1, 3, "", False, False, "")


def control(stamp_ns: int, **changes: object) -> ControlState:
    return msgspec.structs.replace(BLANK, stamp_ns=stamp_ns, **changes)


def navigation(stamp_ns: int, **changes: object) -> NavigationState:
    return msgspec.structs.replace(NAVIGATION, stamp_ns=stamp_ns, **changes)


@pytest.fixture
def options(tmp_path: Path) -> StackOptions:
    mission = tmp_path / "mission.toml"
    mission.write_text(MISSION)
    return StackOptions(
        "robot",
        str(find_file("diff_drive")),
        mission=str(mission),
        x_m=1.0,
        y_m=1.0,
        state=str(tmp_path / "state"),
        run="first",
    )


def keeper(options: StackOptions, *, localised: bool = False) -> ProgressKeeper:
    saved, notes = load_progress(options)
    assert notes == ()
    return ProgressKeeper(progress_file(Path(options.state)), options, saved, localised=localised)


def on_disk(options: StackOptions) -> StoredProgress:
    saved, _ = load_progress(options)
    assert saved is not None
    return saved


def test_a_driving_robot_is_saved_every_five_seconds_and_a_stopped_one_at_once(
    options: StackOptions,
) -> None:
    kept, saves = keeper(options), []
    for tenth in range(121):
        now_ns = tenth * SECOND_NS // 10
        driving = tenth < 113
        metres = 0.04 * min(tenth, 113)
        state = control(now_ns, odometer_m=metres, v_m_s=0.4 if driving else 0.0)
        kept.step([state, navigation(now_ns)], now_ns)
        if not saves or on_disk(options).odometer_m != saves[-1][1]:
            saves.append((tenth, on_disk(options).odometer_m))
    assert [tenth for tenth, _ in saves] == [0, 50, 100, 113]
    assert saves[-1][1] == pytest.approx(4.52)


@pytest.mark.parametrize("silent", ["control", "navigation"])
def test_the_last_words_of_a_process_that_falls_silent_are_saved_before_it_is_back(
    options: StackOptions, silent: str
) -> None:
    kept = keeper(options)
    for tenth in range(20):
        now_ns = tenth * SECOND_NS // 10
        messages = []
        if silent != "control" or tenth < 12:
            messages.append(control(now_ns, odometer_m=100.0 + tenth, v_m_s=0.4))
        if silent != "navigation" or tenth < 12:
            messages.append(navigation(now_ns, item_s_m=0.1 * tenth))
        kept.step(messages, now_ns)
        if tenth == 15:
            break
    saved = on_disk(options)
    assert (saved.odometer_m if silent == "control" else saved.item_s_m) == pytest.approx(
        111.0 if silent == "control" else 1.1
    )


def test_a_new_mission_item_is_saved_at_once(options: StackOptions) -> None:
    kept = keeper(options)
    kept.step([control(0, v_m_s=0.4), navigation(0)], 0)
    kept.step([navigation(100_000_000, item=2)], 100_000_000)
    assert on_disk(options).item == 2


def test_a_recorder_that_restarts_does_not_forget_the_item_before_navigation_speaks(
    options: StackOptions,
) -> None:
    keeper(options).step([control(0), navigation(0, item_s_m=3.0)], 0)
    again = keeper(options)
    again.step([control(9 * SECOND_NS, odometer_m=5.0)], 9 * SECOND_NS)
    assert on_disk(options).item == 1
    assert on_disk(options).item_s_m == 3.0
    assert on_disk(options).odometer_m == 5.0


def test_a_disk_that_refuses_is_said_every_10_s_and_tried_again(options: StackOptions) -> None:
    kept = keeper(options)
    folder = Path(options.state)
    folder.rmdir()
    said = [
        kept.step([control(now * SECOND_NS, odometer_m=float(now))], now * SECOND_NS)
        for now in range(20)
    ]
    assert [now for now, notes in enumerate(said) if notes] == [0, 10]
    assert "progress.json: cannot be written" in said[0][0]
    folder.mkdir()
    kept.step([control(30 * SECOND_NS, odometer_m=30.0)], 30 * SECOND_NS)
    assert on_disk(options).odometer_m == 30.0


def test_the_odometer_goes_on_over_runs_and_the_pose_only_within_one(
    options: StackOptions,
) -> None:
    saved = StoredProgress("first", 1234.5, 3.0, 4.0, 0.5)
    keeper(options)
    progress_file(Path(options.state)).save(saved)
    same, odometer_m, (note,) = continued(options)
    assert (same.x_m, same.y_m, same.theta_rad, odometer_m) == (3.0, 4.0, 0.5, 1234.5)
    assert "x 3.00 m" in note
    other = msgspec.structs.replace(options, run="second")
    assert continued(other) == (other, 1234.5, ())


def test_a_localiser_that_is_never_at_rest_does_not_wear_out_the_disk(
    options: StackOptions,
) -> None:
    kept = keeper(options)
    kept.step([control(0, x_m=1.0)], 0)
    for second in range(1, 60):
        here = control(second * SECOND_NS, x_m=1.0 + 0.002 * math.sin(second), theta_rad=1e-3)
        kept.step([here], second * SECOND_NS)
    assert (on_disk(options).x_m, on_disk(options).theta_rad) == (1.0, 0.0)
    kept.step([control(60 * SECOND_NS, x_m=1.012)], 60 * SECOND_NS)
    assert on_disk(options).x_m == 1.012
    kept.step([control(66 * SECOND_NS, x_m=1.013)], 66 * SECOND_NS)
    kept.close()
    assert on_disk(options).x_m == 1.013


@pytest.mark.parametrize(
    ("run", "expected"), [("first", SE2(3.0, 4.0, 0.5)), ("second", None)], ids=["again", "new"]
)
def test_navigation_that_starts_again_tells_its_estimators_where_the_robot_was(
    options: StackOptions,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path_factory: pytest.TempPathFactory,
    run: str,
    expected: SE2 | None,
) -> None:
    told: list[SE2 | None] = []

    def load(_config: object, _options: object, last: SE2 | None, _say: object) -> None:
        told.append(last)

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("run")))
    monkeypatch.setattr(navigation_process, "StopFlag", lambda: lambda: True)
    monkeypatch.setattr(navigation_process, "load_estimators", load)
    progress_file(Path(options.state)).save(StoredProgress("first", 0.0, 3.0, 4.0, 0.5))
    navigation_process.run(CONFIG, msgspec.structs.replace(options, run=run))
    assert told == [expected]


def test_the_last_pose_is_that_of_this_run_alone(options: StackOptions) -> None:
    saved = StoredProgress(options.run, 0.0, 3.0, 4.0, 0.5)
    assert options.run
    assert last_pose(saved, options) == SE2(3.0, 4.0, 0.5)
    assert last_pose(saved, msgspec.structs.replace(options, run="second")) is None
    assert last_pose(None, options) is None
    unreadable = StoredProgress("", math.nan, 0.0, 0.0, 0.0)
    assert last_pose(unreadable, msgspec.structs.replace(options, run="")) is None


def test_the_pose_that_is_saved_is_that_in_the_world(options: StackOptions) -> None:
    there = LocalisationState(
        0, "mcl", LocalisationStatus.LOCALISED, 10.0, 20.0, math.pi / 2, (0.0,) * 6
    )
    keeper(options).step([there, control(0, x_m=1.0, y_m=2.0, theta_rad=0.0)], 0)
    saved = on_disk(options)
    assert (saved.x_m, saved.y_m, saved.theta_rad) == pytest.approx((8.0, 21.0, math.pi / 2))


def test_a_recorder_that_restarts_does_not_take_the_odometry_for_the_place_in_the_world(
    options: StackOptions,
) -> None:
    there = LocalisationState(0, "mcl", LocalisationStatus.LOCALISED, 10.0, 0.0, 0.0, (0.0,) * 6)
    first = keeper(options, localised=True)
    first.step([control(0, x_m=1.0)], 0)
    assert on_disk(options).x_m == 1.0
    first.step([there, control(SECOND_NS, x_m=2.0)], SECOND_NS)
    assert on_disk(options).x_m == 12.0

    second = keeper(options, localised=True)
    second.step([control(10 * SECOND_NS, x_m=2.5)], 10 * SECOND_NS)
    second.close()
    assert on_disk(options).x_m == 12.0
    second.step([there, control(11 * SECOND_NS, x_m=2.5)], 11 * SECOND_NS)
    assert on_disk(options).x_m == 12.5


def test_while_the_place_is_a_guess_the_way_since_the_last_known_one_is_saved(
    options: StackOptions,
) -> None:
    """Known at 10 m, then lost: guesses jump about the map, the odometry says a metre more."""
    known = LocalisationState(0, "mcl", LocalisationStatus.LOCALISED, 9.0, 0.0, 0.0, (0.0,) * 6)
    keeper_ = keeper(options, localised=True)
    keeper_.step([known, control(0, x_m=1.0)], 0)
    for second, status in enumerate((LocalisationStatus.LOST, LocalisationStatus.SEARCHING), 1):
        now_ns = 10 * second * SECOND_NS
        guess = LocalisationState(now_ns, "mcl", status, -40.0, 7.0 * second, 2.0, (0.0,) * 6)
        keeper_.step([guess, control(now_ns, x_m=1.0 + 0.5 * second)], now_ns)
        saved = on_disk(options)
        assert (saved.x_m, saved.y_m, saved.theta_rad) == pytest.approx(
            (10.0 + 0.5 * second, 0.0, 0.0)
        )


def test_a_robot_that_has_not_found_its_place_still_counts_its_way(options: StackOptions) -> None:
    guess = LocalisationState(0, "mcl", LocalisationStatus.SEARCHING, 50.0, 5.0, 1.0, (0.0,) * 6)
    keeper_ = keeper(options, localised=True)
    keeper_.step([guess, control(0, x_m=1.0, odometer_m=100.0)], 0)
    later = control(10 * SECOND_NS, x_m=4.0, odometer_m=103.0)
    keeper_.step([guess, later], 10 * SECOND_NS)
    assert (on_disk(options).x_m, on_disk(options).odometer_m) == (1.0, 103.0)


def test_the_odometer_is_what_was_saved_and_what_was_driven_since() -> None:
    core = make_core(CONFIG, StackOptions("x", ""))
    core.odometer_start_m = 1000.0
    core.motion.odometry.update((10.0, 10.0), ())
    state = core.snapshot(0, LoopStatistics())
    assert state.distance_m == pytest.approx(10.0 * CONFIG.drive.wheel_radius_m)
    assert state.odometer_m == pytest.approx(1000.0 + state.distance_m)


def test_an_odometer_that_cannot_be_read_is_unknown_and_never_saved_over(
    options: StackOptions,
) -> None:
    state = Path(options.state)
    (state / "progress.json").mkdir(parents=True)
    _, odometer_m, (note,) = continued(options)
    assert math.isnan(odometer_m)
    assert "progress.json: cannot be read" in note
    (state / "progress.json").rmdir()
    keeper(options).step([control(0, odometer_m=odometer_m)], 0)
    assert list(state.iterdir()) == []


def test_auto_goes_on_within_the_interrupted_item_and_only_when_it_is_asked_for(
    options: StackOptions,
) -> None:
    adapter = make_navigation(CONFIG, options)
    adapter.navigator.auto.resume(1, 5.0)
    now_ns = SECOND_NS

    def step(*requests: SetMode) -> tuple[float, NavigationState]:
        nonlocal now_ns
        now_ns += adapter.period_ns
        clear = (math.inf,) * len(CONFIG.sonar)
        state = control(
            now_ns, state=SafetyState.ARMED, x_m=6.0, y_m=1.0, theta_rad=0.0, sonar_m=clear
        )
        command, navigated = adapter.step(state, None, requests, now_ns)
        return command.v_m_s, navigated

    for _ in range(5):
        v_m_s, state = step()
        assert (v_m_s, state.mode, state.item) == (0.0, Mode.HOLD, 1)
    v_m_s, state = step(SetMode(now_ns, Mode.AUTO))
    assert state.mode is Mode.AUTO
    assert state.item == 1
    assert state.item_s_m == pytest.approx(5.0)
    assert v_m_s > 0.0


def test_a_run_is_resumed_only_with_its_own_mission(options: StackOptions) -> None:
    with pytest.raises(StateError, match="there is no run to resume"):
        resumed(options, 3)
    keeper(options).step([control(0), navigation(0)], 0)
    later, saved, notes = resumed(msgspec.structs.replace(options, run="second"), 3)
    assert notes == ()
    assert later.run == "first"
    assert saved.item == 1
    Path(options.mission).write_text(MISSION + "# changed\n")
    with pytest.raises(StateError, match="another mission"):
        resumed(options, 3)


def write_progress(options: StackOptions, **changes: object) -> Path:
    """Write a state file with a correct checksum, whatever its values are."""
    path = progress_file(Path(options.state)).path
    values = {
        "run": "first",
        "odometer_m": 5.0,
        "x_m": 1.0,
        "y_m": 1.0,
        "theta_rad": 0.0,
        "mission_crc": mission_crc(options.mission),
        "item": 1,
        "item_s_m": 0.0,
    }
    body = msgspec.json.encode(values | changes)
    path.write_bytes(b"robotctl-state 1 %d %08x\n" % (len(body), zlib.crc32(body)) + body)
    return path


def test_a_file_written_by_hand_is_read(options: StackOptions) -> None:
    write_progress(options, x_m=-999_999.0, item=3)
    _, saved, notes = resumed(options, 3)
    assert (saved.x_m, saved.item, notes) == (-999_999.0, 3, ())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("item", -1),
        ("item_s_m", -0.001),
        ("x_m", 1e308),
        ("x_m", -1e6),
        ("y_m", 1e6),
        ("odometer_m", -1.0),
    ],
)
def test_a_value_that_no_robot_has_is_damage_and_the_generation_before_counts(
    options: StackOptions, name: str, value: float
) -> None:
    path = write_progress(options, **{name: value})
    with pytest.raises(StateError, match=rf"(?s)damaged .*{name}.* must be .*no run to resume"):
        resumed(options, 3)
    assert path.with_name("progress.json.damaged-1").exists()
    write_progress(options, item=2).rename(path.with_name("progress.json.previous"))
    write_progress(options, **{name: value})
    _, saved, (note,) = resumed(options, 3)
    assert saved.item == 2
    assert "progress.json.damaged-2" in note


def test_a_state_that_could_not_be_read_again_is_not_saved(options: StackOptions) -> None:
    kept = keeper(options)
    kept.step([control(0)], 0)
    for worse in ({"x_m": math.nan}, {"y_m": 2e6}, {"theta_rad": math.inf}):
        assert kept.step([control(9 * SECOND_NS, odometer_m=7.0, **worse)], 9 * SECOND_NS) == ()
    assert on_disk(options).odometer_m == 0.0


def test_an_item_beyond_the_mission_resumes_nothing_and_navigation_begins_anew(
    options: StackOptions,
) -> None:
    write_progress(options, item=4)
    with pytest.raises(StateError, match="mission has 3 items, against 4 done"):
        resumed(options, 3)
    adapter = make_navigation(CONFIG, options)
    (note,) = resume(adapter, options, load_progress(options)[0])
    assert note == f"{options.state}: item must be 0 to 3, not 4; mode AUTO starts the mission over"
    assert adapter.step(None, None, [], 0)[1].item == 0


def test_a_completed_mission_is_said_to_be_completed_behind_a_restart(
    options: StackOptions,
) -> None:
    write_progress(options, item=3)
    adapter = make_navigation(CONFIG, options)
    (note,) = resume(adapter, options, load_progress(options)[0])
    assert note == "the mission is completed; mode AUTO repeats it"
    assert adapter.step(None, None, [], 0)[1].mission_completed


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"STATE_DIRECTORY": "/var/lib/robotctl", "XDG_STATE_HOME": "/x"}, "/var/lib/robotctl"),
        ({"XDG_STATE_HOME": "/home/me/state"}, "/home/me/state/robotctl"),
    ],
)
def test_state_lives_where_systemd_or_the_desktop_say(
    environment: dict[str, str], expected: str
) -> None:
    assert state_directory(environment) == Path(expected)


def test_a_user_without_a_home_is_told_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(number: int) -> None:
        raise KeyError(f"getpwuid(): uid not found: {number}")

    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr("pwd.getpwuid", nobody)
    with pytest.raises(StateError, match="XDG_STATE_HOME"):
        state_directory({})


def test_a_mission_that_was_loaded_is_the_one_that_goes_on_behind_a_restart(
    options: StackOptions, tmp_path: Path
) -> None:
    file = tmp_path / "rounds.toml"
    file.write_text(MISSION.replace("out and back", "rounds") + ROUNDS)
    adapter = make_navigation(CONFIG, options)
    load = LoadMission(0, str(file), file.read_bytes())
    _, state = adapter.step(control(0), None, [load, JumpToItem(0, "again")], 0)
    assert (state.mission, state.item, state.mission_commands) == ("rounds", 3, 2)
    keeper(options).step([control(0), msgspec.structs.replace(state, loop_counts=(1,))], 0)
    later = make_navigation(CONFIG, options)
    notes = resume(later, options, on_disk(options))
    assert notes == ("the mission is at item 4; mode AUTO resumes there",)
    _, state = later.step(control(0), None, [], 0)
    assert (state.mission, state.item, state.loop_counts) == ("rounds", 3, (1,))
    assert state.mission_file == str(file)
    again, saved, _ = resumed(msgspec.structs.replace(options, run="second"), 3)
    assert (again.mission, saved.loop_counts) == (str(file), (1,))
    file.write_text(MISSION)
    assert resume(make_navigation(CONFIG, options), options, on_disk(options)) == ()


def test_home_stays_where_it_was_moved_to_behind_a_restart(options: StackOptions) -> None:
    adapter = make_navigation(CONFIG, options)
    _, state = adapter.step(control(0), None, [SetHome(0, 2.0, 1.0, 0.5)], 0)
    assert state.home == (2.0, 1.0, 0.5)
    keeper(options).step([control(0), state], 0)
    later = make_navigation(CONFIG, options)
    resume(later, options, on_disk(options))
    _, state = later.step(control(0), None, [], 0)
    assert state.home == (2.0, 1.0, 0.5)


def test_a_mission_that_is_none_is_told_and_leaves_the_present_one(options: StackOptions) -> None:
    adapter = make_navigation(CONFIG, options)
    _, state = adapter.step(control(0), None, [LoadMission(0, "x.toml", b"name = 1")], 0)
    assert (state.mission, state.mission_runs) == ("out and back", 0)
    assert "mission refused: x.toml:1: name: " in adapter.take_notices()[0]
