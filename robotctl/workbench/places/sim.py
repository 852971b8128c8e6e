"""The simulated robot turns on the spot, in lockstep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.errors import PlaceError
from robotctl.estimation.places.signatures import SignatureConfig
from robotctl.messages.control import Arm, ControlRequest, SafetyState, VelocityCommand
from robotctl.model.geometry.se2 import SE2
from robotctl.safety.state_machine import LATCHED, POWERED
from robotctl.workbench.places.turns import Progress, StateTurns, Visited

_TURN_RAD_S: Final = 0.6
_COMMAND_NS: Final = 200_000_000
_STATE_NS: Final = 20_000_000
_PATIENCE_S: Final = 60.0


def simulated_turn(
    path: Path,
    robot: RobotConfig,
    overrides: Sequence[str],
    world: Path,
    start: SE2,
    seed: int,
    signatures: SignatureConfig,
    progress: Progress,
) -> Visited:
    """Let the simulated robot turn on the spot once, in lockstep.

    Raises
    ------
    SimulatorError
        If the robot cannot stand there.
    PlaceError
        If it has no sonars, cannot turn on the spot, or is stopped.
    """
    if robot.drive.min_turning_radius_m > 0.0:
        raise PlaceError(f"{robot.robot.name} has steering: it cannot turn on the spot")
    if not robot.sonar:
        raise PlaceError(f"{path}: the robot has no sonars")
    at = (start.x_m, start.y_m, start.theta_rad)
    simulation = make_simulation(path, world, seed, at, overrides)
    options = StackOptions("places", str(path), tuple(overrides), "", *at)
    stack = LockstepStack(robot, options, simulation)
    turns = StateTurns(robot, signatures)
    every = max(1, _STATE_NS // stack.period_ns)
    omega = min(_TURN_RAD_S, robot.limits.omega_max_rad_s)
    while stack.clock.now_ns() < _PATIENCE_S * 1e9:
        stack.tick(_wish(stack, omega))
        if stack.ticks % every:
            continue
        control = stack.snapshot()
        turn = turns.step(control)
        progress(turns.turned_rad)
        truth = simulation.truth()
        if truth.collisions:
            raise PlaceError(f"the robot hit something while turning at {_place(start)}")
        if control.state in LATCHED:
            raise PlaceError(f"the robot stopped by itself: {control.reason}")
        if turn is not None:
            T_world_odom = (
                SE2(truth.x_m, truth.y_m, truth.theta_rad) @ control.T_odom_base.inverse()
            )
            return Visited(turn, T_world_odom @ turn.odometry)
    raise PlaceError(
        f"the robot turned by {math.degrees(turns.turned_rad):.0f} deg in {_PATIENCE_S:g} s, "
        "360 deg are needed"
    )


def _wish(stack: LockstepStack, omega_rad_s: float) -> tuple[ControlRequest, ...]:
    """Return the requests to the simulated robot: to arm, then to turn."""
    now_ns, state = stack.clock.now_ns() + stack.period_ns, stack.core.machine.state
    if state in POWERED:
        return (VelocityCommand(now_ns, now_ns + _COMMAND_NS, 0.0, omega_rad_s),)
    if state == SafetyState.STANDBY:
        return (Arm(now_ns, stack.ticks, arm=True),)
    return ()


def _place(pose: SE2) -> str:
    return f"x {pose.x_m:g} m, y {pose.y_m:g} m"
