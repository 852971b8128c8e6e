"""A simulated robot's run beside which somebody else acts: an operator, or the end of a process."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from pymavlink import mavutil

from hil_tests.processes import children_of
from robotctl.app.simulation.run_status import RunStatus
from robotctl.app.simulation.sim import SimRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.supervision.stack import NAVIGATION
from robotctl.config.robot_file import find_file
from robotctl.messages.control import Mode, SafetyState
from robotctl.messages.faults import FaultCode
from robotctl.model.geometry.localisation import LocalisationStatus
from tests.firmware_sim.world.cell_rooms import room_map

PATIENT_S = 60.0
QUIET_S = 2.0
"""Longer than the run waits before it asks again for what it wants."""

WAY_M = 2.5
"""From the start: more than any localiser may be off."""

ERROR_M = 0.3

PAUSES = 5
PAUSE_S = 0.25
"""Of the simulator: less than what it may be held up for."""

HOLD = 4
MAVLINK = mavutil.mavlink
CUSTOM = MAVLINK.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


def own(bus: str, name: str) -> str:
    """Return the bus of a run: on simcan it is nobody else's."""
    return f"simcan:{name}-{os.getpid()}" if bus == "simcan" else bus


class Operator:
    """A ground station beside a run that stays."""

    def __init__(self, run: SimRun, port: int) -> None:
        self._steps: Iterator[RunStatus] = run.steps(until_done=False)
        self.until(lambda _: self._listens(port))
        self._link = cast("Any", mavutil).mavlink_connection(f"tcp:127.0.0.1:{port}")

    @staticmethod
    def _listens(port: int) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    def until(self, reached: Callable[[RunStatus], bool]) -> RunStatus:
        """Let the run go on until something is so."""
        begin_s = None
        for progress in self._steps:
            begin_s = progress.elapsed_s if begin_s is None else begin_s
            assert progress.elapsed_s - begin_s < PATIENT_S, progress.lines
            faulty = progress.control is not None and progress.control.state == SafetyState.FAULT
            assert not faulty, progress.lines
            if reached(progress):
                return progress
        raise AssertionError("the run has ended")

    def drives_in(self, mode: Mode) -> RunStatus:
        """Let the run go on until the robot drives in a mode."""
        return self.until(
            lambda progress: (
                progress.control is not None
                and progress.control.state == SafetyState.DRIVING
                and progress.navigation is not None
                and progress.navigation.mode == mode
            )
        )

    def close(self) -> None:
        """Hang up."""
        self._link.close()

    def command(self, number: int, *params: float) -> None:
        """Send a command."""
        given = (*params, *(7 - len(params)) * (0.0,))
        self._link.mav.command_long_send(1, 1, number, 0, *given)

    def sees_nothing_but(self, state: SafetyState, mode: Mode) -> None:
        """Wait for a state and a mode, and see that they stay."""
        began_s = self.until(
            lambda progress: (
                progress.control is not None
                and progress.control.state == state
                and progress.navigation is not None
                and progress.navigation.mode == mode
            )
        ).elapsed_s

        def quiet(progress: RunStatus) -> bool:
            assert progress.control is not None
            assert progress.navigation is not None
            assert (progress.control.state, progress.navigation.mode) == (state, mode)
            return progress.elapsed_s - began_s > QUIET_S

        self.until(quiet)


@pytest.fixture
def operator(bus: str) -> Iterator[Operator]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = SimOptions(
        find_file("diff_drive"),
        find_file("patrol", "missions"),
        bus=own(bus, "operator"),
        overrides=(f'mavlink.link=[{{url="tcpin:127.0.0.1:{port}"}}]',),
    )
    with SimRun(options) as run, contextlib.closing(Operator(run, port)) as beside:
        yield beside


def test_the_robot_stays_as_the_operator_left_it(operator: Operator) -> None:
    operator.drives_in(Mode.AUTO)
    operator.command(MAVLINK.MAV_CMD_DO_SET_MODE, CUSTOM, HOLD)
    operator.sees_nothing_but(SafetyState.ARMED, Mode.HOLD)
    operator.command(MAVLINK.MAV_CMD_DO_SET_MODE, CUSTOM, 10)
    operator.drives_in(Mode.AUTO)
    operator.command(MAVLINK.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    operator.sees_nothing_but(SafetyState.STANDBY, Mode.HOLD)
    operator.command(MAVLINK.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    operator.sees_nothing_but(SafetyState.ARMED, Mode.HOLD)


def pid_of(module: str) -> int:
    """Return the process id of a child of this process that runs a module."""
    found = [pid for pid, line in children_of(os.getpid()).items() if module.encode() in line]
    (pid,) = found
    return pid


def error_m(progress: RunStatus) -> float:
    """Return the distance between where the robot believes to be and where it is [m]."""
    control, truth = progress.control, progress.truth
    if control is None or truth is None:
        return math.nan
    return math.hypot(control.x_m - truth.x_m, control.y_m - truth.y_m)


@pytest.mark.timeout(240)
def test_a_localiser_that_is_killed_under_way_knows_the_place_again_and_nothing_drives_on(
    bus: str,
) -> None:
    if bus != "simcan":
        pytest.skip("what a localiser does, the bus does not change: on simcan alone")
    options = SimOptions(
        find_file("diff_drive"),
        find_file("patrol", "missions"),
        bus=own(bus, "restart"),
        max_seconds=200.0,
        overrides=("mavlink.link=[]",),
        localisation=('localisation.method="ekf"',),
    )
    killed_ns = 0
    with SimRun(options) as run:
        for progress in run.steps():
            control, truth, navigation = progress.control, progress.truth, progress.navigation
            if control is None or truth is None or navigation is None:
                continue
            assert killed_ns or control.state != SafetyState.FAULT, progress.lines
            start = run.mission.start
            if not killed_ns and math.hypot(truth.x_m - start.x_m, truth.y_m - start.y_m) > WAY_M:
                assert error_m(progress) < ERROR_M
                os.kill(pid_of(NAVIGATION), signal.SIGKILL)
                killed_ns = time.monotonic_ns()
                distance_m = truth.distance_m
            place = progress.localisation
            again_ns = min(navigation.stamp_ns, 0 if place is None else place.stamp_ns)
            # Until it has seen something, the place where it was last is a guess.
            knows = place is not None and place.status is LocalisationStatus.LOCALISED
            if 0 < killed_ns < again_ns < control.stamp_ns and knows:
                break
        assert killed_ns
        assert any("navigation ended" in line for line in progress.lines)
        assert place is not None
        assert place.status is LocalisationStatus.LOCALISED
        assert navigation.mode is Mode.HOLD
        assert error_m(progress) < ERROR_M
        assert truth.distance_m - distance_m < 0.5


@pytest.mark.timeout(240)
def test_processes_drive_and_look_and_localise_in_a_ros_map(bus: str, tmp_path: Path) -> None:
    if bus != "simcan":
        pytest.skip("what a localiser does, the bus does not change: on simcan alone")
    room_map(tmp_path, side_m=0.05, times=5)
    mission = tmp_path / "round.toml"
    mission.write_text(
        'name = "round"\nworld = "room.yaml"\nstart = { x_m = 0.6, y_m = 3.9 }\n[[item]]\n'
        'kind = "drive"\nwaypoints = [[0.6, 3.9], [1.4, 3.9], [1.4, 4.8]]\ncorner_radius_m = 0.3\n'
    )
    options = SimOptions(
        find_file("diff_drive"),
        mission,
        bus=own(bus, "map"),
        max_seconds=200.0,
        overrides=("mavlink.link=[]", "camera.enabled=true"),
        localisation=('localisation.method="mcl"',),
    )
    with SimRun(options) as run:
        for progress in run.steps():
            assert progress.control is None or progress.control.state != SafetyState.FAULT
        report = run.report()
    assert report.mission_completed, report.message
    assert (report.world, report.collisions, report.unsafe_motions) == ("room", 0, 0)
    assert report.localisation is not None
    assert report.localisation.error.max_m < ERROR_M
    assert report.camera is not None
    assert report.camera.pictures > 10
    assert report.camera.false == 0


@pytest.mark.timeout(240)
@pytest.mark.parametrize("hard", [False, True], ids=["waiting", "hard real time"])
def test_simulated_time_stands_still_while_the_computer_is_held_up(
    bus: str, hard: bool, tmp_path: Path
) -> None:
    mission = tmp_path / "there.toml"
    mission.write_text(
        'name = "there"\nworld = "flat"\nstart = { x_m = 1.0, y_m = 1.0 }\n[[item]]\n'
        'kind = "drive"\nwaypoints = [[1.0, 1.0], [3.0, 1.0]]\n'
    )
    options = SimOptions(
        find_file("diff_drive"),
        mission,
        bus=own(bus, "held"),
        max_seconds=100.0,
        overrides=("mavlink.link=[]",),
        hard_real_time=hard,
    )
    began_ns, pauses, lines = time.monotonic_ns(), 0, []
    with SimRun(options) as run:
        for progress in run.steps():
            lines += progress.lines
            progress.lines.clear()
            truth = progress.truth
            if truth is not None and truth.distance_m > 0.3 * (pauses + 1) and pauses < PAUSES:
                simulator = pid_of("firmware_sim")
                os.kill(simulator, signal.SIGSTOP)
                time.sleep(PAUSE_S)
                os.kill(simulator, signal.SIGCONT)
                pauses += 1
        report = run.report()
    took_s = (time.monotonic_ns() - began_ns) / 1e9
    said = [line for line in lines if "this computer was held up for" in line]
    assert report.held_up_ms > 900.0 * PAUSE_S
    assert report.unsafe_motions == report.collisions == 0
    if hard:
        assert not report.mission_completed
        assert any("`--lockstep` does not depend on it" in line for line in said), lines
    else:
        assert report.mission_completed, report.message
        assert report.real_time_factor * took_s < took_s - PAUSES * 0.8 * PAUSE_S
        assert any("simulated time paused" in line for line in said), lines


@pytest.mark.timeout(240)
def test_a_simulator_that_somebody_stopped_is_told_as_such(bus: str) -> None:
    """Nothing comes from the bus: neither control nor this computer was held up."""
    options = SimOptions(
        find_file("diff_drive"),
        find_file("patrol", "missions"),
        bus=own(bus, "stopped"),
        max_seconds=100.0,
        overrides=("mavlink.link=[]",),
    )
    lines: list[str] = []
    stopped = 0
    with SimRun(options) as run:
        for progress in run.steps():
            lines += progress.lines
            progress.lines.clear()
            if not stopped and progress.truth is not None and progress.truth.distance_m > 0.3:
                stopped = pid_of("firmware_sim")
                os.kill(stopped, signal.SIGSTOP)
            control = progress.control
        os.kill(stopped, signal.SIGCONT)
    assert control is not None
    assert control.state is SafetyState.FAULT
    # Blocked, once the socket that stands for the bus is full.
    assert control.fault in {FaultCode.BUS_SILENT, FaultCode.BUS_BLOCKED}, control.reason
    assert "nothing has come from the CAN bus for" in control.reason
    assert any(
        line.startswith("firmware_sim is held up:") and "stopped by a signal" in line
        for line in lines
    ), lines
    assert not any("control was held up" in line for line in lines), lines
