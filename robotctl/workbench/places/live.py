"""A turn on the spot of a running robot, real or simulated, by listening to its states."""

from __future__ import annotations

from typing import Any, Final

import zmq

from robotctl.app.supervision.running_robot import running
from robotctl.config.robot_file import RobotConfig
from robotctl.errors import PlaceError
from robotctl.estimation.places.signature_turn import Turn
from robotctl.estimation.places.signatures import SignatureConfig
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.ports import Clock
from robotctl.messages.world_pose import WorldPose
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.ipc.topics import Subscriber
from robotctl.workbench.places.turns import Progress, StateTurns, Visited

_SILENT_NS: Final = 5_000_000_000
"""Time within which a running robot publishes something."""
_PATIENCE_NS: Final = 300_000_000_000
_POLL_NS: Final = 20_000_000


def live_turn(
    instance: str,
    robot: RobotConfig,
    signatures: SignatureConfig,
    began: SE2 | None,
    progress: Progress,
    clock: Clock,
) -> Visited:
    """Listen to a running robot until it has turned on the spot once.

    Its localiser gives the end pose, if known and `began` is None.

    Raises
    ------
    LinkError
        If no robot of that name runs.
    PlaceError
        If it falls silent, or does not turn.
    """
    context: zmq.Context[Any] = zmq.Context()
    try:
        endpoints = running(instance)
        kinds = ControlState | LocalisationState
        states = Subscriber[ControlState | LocalisationState](context, endpoints.published, kinds)
        turns = StateTurns(robot, signatures)
        world = WorldPose(has_localiser=True)
        began_ns = heard_ns = clock.now_ns()
        while clock.now_ns() - began_ns < _PATIENCE_NS:
            for message in states.receive():
                heard_ns = clock.now_ns()
                if isinstance(message, LocalisationState):
                    world.localise(message)
                    continue
                turn = _live_step(turns, message, robot)
                if turn is not None:
                    T_world_odom = world.T_world_odom(message) if world.is_sure(message) else None
                    known = None if T_world_odom is None else T_world_odom @ turn.odometry
                    return Visited(turn, known if began is None else _ended(turn, began))
            if clock.now_ns() - heard_ns > _SILENT_NS:
                raise PlaceError(
                    f"{instance}: no messages from the robot for {_SILENT_NS / 1e9:g} s"
                )
            progress(turns.turned_rad)
            clock.sleep_until(clock.now_ns() + _POLL_NS)
        raise PlaceError(f"{instance}: no turn on the spot within {_PATIENCE_NS / 1e9:g} s")
    finally:
        context.destroy(linger=0)


def _live_step(turns: StateTurns, control: ControlState, robot: RobotConfig) -> Turn | None:
    """Take a state of a running robot; its sonars must be those of the file."""
    if len(control.sonar_m) != len(robot.sonar):
        raise PlaceError(
            f"the running robot has {len(control.sonar_m)} sonars, that of the file "
            f"{robot.robot.name} {len(robot.sonar)}: give its --robot"
        )
    return turns.step(control)


def _ended(turn: Turn, began: SE2) -> SE2:
    """Return where a turn ended that began at a pose in `world`."""
    return began @ turn.began.inverse() @ turn.odometry
