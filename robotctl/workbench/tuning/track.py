"""The simulated robot on a straight track, in lockstep, and a step of its closed loop.

The robot starts at the west end of the corridor of `configs/worlds/office.toml`, and each
experiment has a simulation of its own, so all start from the same state.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig, find_file
from robotctl.errors import RobotctlError
from robotctl.messages.control import Arm, SafetyState, VelocityCommand
from robotctl.safety.state_machine import LATCHED

WORLD: Final = "office"
START: Final = (1.5, 7.5, 0.0)
ROOM_M: Final = 24.0
"""Straight floor ahead of the start [m]."""

READY_S: Final = 3.0
"""Maximum time of the nodes until the robot can be armed [s]."""

_REST_S: Final = 0.1
_COMMAND_NS: Final = 100_000_000

Array: TypeAlias = NDArray[np.float64]


class ExperimentError(RobotctlError):
    """An experiment could not be carried out; the message says why."""


@dataclass(frozen=True, slots=True)
class ExperimentSetting:
    """Setting of an experiment: robot and track.

    Parameters
    ----------
    robot
        The robot's file.
    overrides
        `key=value` settings on top of it.
    seed
        Seed of the simulated world.
    charge
        Charge of the battery at the start, [0, 1]; None: as the robot's file says.
    """

    robot: Path
    overrides: tuple[str, ...] = ()
    seed: int = 1
    charge: float | None = None

    def stack(self, config: RobotConfig) -> LockstepStack:
        """Return a fresh robot, controlled by `config`, at the start of the track."""
        overrides = self.overrides
        if self.charge is not None:
            overrides = (*overrides, f"simulation.battery.charge={float(self.charge)}")
        simulation = make_simulation(
            self.robot, find_file(WORLD, "worlds"), self.seed, START, overrides
        )
        x_m, y_m, theta_rad = START
        options = StackOptions(
            "tune", str(self.robot), overrides, x_m=x_m, y_m=y_m, theta_rad=theta_rad
        )
        return LockstepStack(config, options, simulation)


def check_room(stack: LockstepStack) -> None:
    """Raise ExperimentError once the robot has met a wall or is about to leave the track."""
    truth = stack.simulation.truth()
    ahead_m, aside_m = truth.x_m - START[0], truth.y_m - START[1]
    if truth.collisions:
        raise ExperimentError(
            f"not enough room: the robot hit a wall {ahead_m:.1f} m ahead and {aside_m:+.2f} m "
            f"aside of its start in {WORLD}; do the wheels turn equally?"
        )
    if ahead_m > ROOM_M:
        raise ExperimentError(
            f"not enough room: the experiment needs more than the {ROOM_M:g} m of straight floor "
            f"in {WORLD}"
        )


@dataclass(frozen=True, slots=True)
class SpeedStep:
    """A step of the commanded speed from rest, and the loop's response.

    Parameters
    ----------
    time_s
        Since the step was commanded, shape (n,) [s].
    wanted_m_s
        The step's height [m/s].
    reference_m_s, measured_m_s, true_m_s
        The limiter's output, the odometry's speed and the true speed of `base`, shape (n,) [m/s].
    """

    time_s: Array
    wanted_m_s: float
    reference_m_s: Array
    measured_m_s: Array
    true_m_s: Array


def speed_step(stack: LockstepStack, wanted_m_s: float, duration_s: float) -> SpeedStep:
    """Arm, command a speed from rest and record for a time [s], through limiter and loop as in use.

    Raises
    ------
    ExperimentError
        If the robot does not arm, stops with a fault, or has not enough room.
    """
    _arm(stack)
    rows = []
    start_ns = stack.clock.now_ns() + stack.period_ns
    for _ in range(round(duration_s * 1e9 / stack.period_ns)):
        now_ns = stack.clock.now_ns() + stack.period_ns
        stack.tick((VelocityCommand(now_ns, now_ns + _COMMAND_NS, wanted_m_s, 0.0),))
        _check_running(stack)
        check_room(stack)
        state, truth = stack.snapshot(), stack.simulation.truth()
        rows.append((now_ns - start_ns, state.v_ref_m_s, state.v_m_s, truth.v_m_s))
    time_ns, reference, measured, true = np.array(rows, dtype=np.float64).T
    return SpeedStep(time_ns * 1e-9, wanted_m_s, reference, measured, true)


def _arm(stack: LockstepStack) -> None:
    """Wait for the nodes, arm, and let the wheels come to rest."""
    machine = stack.core.machine
    request_id = 1
    for _ in range(round(READY_S * 1e9 / stack.period_ns)):
        if machine.state == SafetyState.ARMED:
            break
        wish: tuple[Arm, ...] = ()
        if machine.state == SafetyState.STANDBY:
            wish = (Arm(stack.clock.now_ns(), request_id, arm=True),)
        stack.tick(wish)
        _check_running(stack)
    else:
        acks = stack.snapshot().acks
        reasons = "; ".join(map(str, acks[-1].reasons)) if acks else ""
        raise ExperimentError(f"the robot does not arm: {reasons or machine.reason}")
    for _ in range(round(_REST_S * 1e9 / stack.period_ns)):
        stack.tick()


def _check_running(stack: LockstepStack) -> None:
    machine = stack.core.machine
    if machine.state in LATCHED:
        raise ExperimentError(f"the robot stopped by itself: {machine.reason}")
