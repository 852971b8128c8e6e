"""Who holds, disarms or stops a simulated robot has it: the run starts it once and no more."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Callable, Iterator
from typing import Any, cast

import pytest
from pymavlink import mavutil

from robotctl.app.config import find_file
from robotctl.app.sim import Progress, SimRun
from robotctl.app.sim_options import SimOptions
from robotctl.runtime.messages import Mode, SafetyState

PATIENT_S = 60.0
PATIENT = "runtime.rate_hz=100"
"""Twice as long as usual may a busy computer stand before the robot stops."""

QUIET_S = 2.0
"""Longer than the run waits before it asks again for what it wants."""

HOLD = 4
MAVLINK = mavutil.mavlink
CUSTOM = MAVLINK.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


class Operator:
    """A ground station beside a run that stays."""

    def __init__(self, run: SimRun, port: int) -> None:
        self._steps: Iterator[Progress] = run.steps(until_done=False)
        self.until(lambda _: self._listens(port))
        self._link = cast("Any", mavutil).mavlink_connection(f"tcp:127.0.0.1:{port}")

    @staticmethod
    def _listens(port: int) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    def until(self, reached: Callable[[Progress], bool]) -> Progress:
        """Let the run go on until something is so."""
        begin_s = None
        for progress in self._steps:
            begin_s = progress.elapsed_s if begin_s is None else begin_s
            assert progress.elapsed_s - begin_s < PATIENT_S, progress.lines
            if reached(progress):
                return progress
        raise AssertionError("the run has ended")

    def drives_in(self, mode: Mode) -> Progress:
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

        def quiet(progress: Progress) -> bool:
            assert progress.control is not None
            assert progress.navigation is not None
            assert (progress.control.state, progress.navigation.mode) == (state, mode)
            return progress.elapsed_s - began_s > QUIET_S

        self.until(quiet)


@pytest.fixture
def operator() -> Iterator[Operator]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = SimOptions(
        find_file("diff_drive"),
        find_file("patrol", "missions"),
        bus=f"simcan:operator-{os.getpid()}",
        overrides=(PATIENT, f'mavlink.link=[{{url="tcpin:127.0.0.1:{port}"}}]'),
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
