"""Whole missions under the virtual clock."""

import collections
from pathlib import Path

import pytest
from mcap.reader import make_reader

from firmware_sim.config.config import SafetySection
from firmware_sim.faults.monitor import Since
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.lockstep_stack import make_simulation
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator_files import SimulatorError
from robotctl.config.robot_file import find_file
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.faults import FaultCode
from robotctl.runtime.flight.recorder import RecordError
from robotctl.safety.state_machine import SafetyConfig
from robotctl.workbench.replay.replay import replay_file
from tests.app.simulation.missions import drive, fingerprint, without_computing_times


@pytest.mark.parametrize(("robot", "seed"), [("diff_drive", 1), ("tricycle", 1), ("ackermann", 2)])
def test_every_drive_completes_the_patrol_without_collision(robot: str, seed: int) -> None:
    report = drive(robot, seed=seed)
    assert report.mission_completed, report.message
    assert report.collisions == 0
    assert report.items_done == report.items
    assert report.pose_error.max_m < 0.02 * report.distance_m
    assert report.bus["errors"] == 0


def test_the_same_seed_gives_the_same_report_and_logs_to_the_byte(tmp_path: Path) -> None:
    runs = [drive(seed=7, max_seconds=12, record=tmp_path / name) for name in ("a", "b")]
    assert without_computing_times(runs[0]) == without_computing_times(runs[1])
    assert fingerprint(tmp_path / "a") == fingerprint(tmp_path / "b")
    drive(seed=8, max_seconds=12, record=tmp_path / "c")
    assert fingerprint(tmp_path / "a") != fingerprint(tmp_path / "c")


def test_the_simulator_takes_limits_time_out_rate_of_pictures_and_its_own_settings() -> None:
    robot, world = find_file("diff_drive"), find_file("hall", "worlds")
    settings = (
        *("limits.v_max_m_s=1.2", "control.left.kp=0.3", "simulation.battery.charge=0.5"),
        *("camera.rate_hz=5", "camera.mount.z_m=0.31"),
        *("safety.command_timeout_ms=60", "safety.sonar_timeout_ms=300"),
    )
    config = make_simulation(robot, world, 1, (6.0, 5.0, 0.0), settings).config
    assert config.limits.v_max_m_s == 1.2
    assert config.safety.command_timeout_ms == 60
    assert config.simulation.battery.charge == 0.5
    assert config.camera is not None
    assert config.camera.rate_hz == 5.0
    assert config.camera.mount.z_m == 0.3


def test_without_a_time_out_in_the_file_the_simulator_has_the_same_as_the_robot() -> None:
    assert SafetySection().command_timeout_ms == SafetyConfig().command_timeout_ms


def test_an_arming_that_the_robot_refused_is_no_leave_to_drive() -> None:
    options = SimOptions(
        find_file("diff_drive"),
        find_file("patrol", "missions"),
        overrides=("simulation.battery.charge=0.04", "safety.arm_timeout_ms=100"),
    )
    run = LockstepRun(options)
    ack = next(control.acks[-1] for control, _ in run.steps() if control.acks)
    assert ack.reasons[0].code == FaultCode.BATTERY_LOW
    for _ in range(20):
        run.stack.open_loop_tick(lambda _: ActuatorCommand(enable=True, values=(0.2, 0.2)))
    assert run.stack.simulation.monitor.findings[-1].since is Since.NOT_ARMED


def test_a_recorded_run_replays_bit_for_bit_with_its_own_configuration(tmp_path: Path) -> None:
    report = drive("tricycle", max_seconds=10, record=tmp_path, overrides=("control.drive.kp=0.3",))
    replayed = replay_file(tmp_path / "control-0001.rec").result
    assert replayed.difference is None
    assert replayed.agreed == round(200 * report.duration_s) > 2000
    with (tmp_path / "robot-0001.mcap").open("rb") as file:
        counts = collections.Counter(
            channel.topic for _, channel, _ in make_reader(file).iter_messages()
        )
    published = round(20 * report.duration_s)
    assert (counts["control"], counts["navigation"]) == (published, published)
    assert counts["notice"] >= 2


def test_what_is_no_record_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="cannot be read"):
        replay_file(tmp_path / "missing.rec")
    (tmp_path / "text").write_text("hello, this is not a record\n")
    with pytest.raises(RecordError, match="not a record"):
        replay_file(tmp_path / "text")


def test_a_run_that_is_cut_short_is_not_completed() -> None:
    report = drive(max_seconds=5)
    assert not report.mission_completed
    assert report.duration_s == pytest.approx(5.5, abs=0.2)  # half a second until it is armed


def test_settings_of_the_simulation_reach_the_firmware_and_wrong_ones_are_named() -> None:
    weak = drive(max_seconds=4, overrides=("simulation.battery.charge=0.02",))
    assert "battery" in weak.message
    with pytest.raises(SimulatorError, match="charge"):
        drive(overrides=("simulation.battery.chrge=0.5",))
