"""Our motor controller as the host drives it: MotorCommand, its node, its emergency stop."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from robotctl.drivers.can.bus_part import Handler, Send
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.drives.native.feedback import NativeFeedback
from robotctl.drivers.can.drives.native.settings import CLEAR_FAULTS, drive_script
from robotctl.drivers.can.e2e import AliveCounter
from robotctl.drivers.can.nodes.motor import FRAMES
from robotctl.drivers.can.nodes.own_node import OwnNode, Sink
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import EmergencyStopSource, NodeStatus
from robotctl.model.actuators import Takes

NODE_ID: Final = 1
SERVO: Final = 3
"""Number of the axis of the steering servo."""

_NOTHING: Final[list[Any]] = [None] * len(FRAMES)


class NativeDrive:
    """Our motor controller.

    Parameters
    ----------
    name
        Name of the drive.
    axes
        Wheels on channels 1 and 2, a joint on `SERVO`.
    needs
        Demands of the robot.
    """

    wants_sync = True
    proof = ""

    def __init__(self, name: str, axes: tuple[Axis, ...], needs: DriveNeeds) -> None:
        codec = self._codec = needs.codec
        self._notes = needs.notes
        self._channels = [
            (place, axis.number - 1, axis.current_a(1.0)) for place, axis in enumerate(axes)
        ]
        """Place, channel from 0, and sign of each axis."""
        self._alive = AliveCounter()
        self._feedback = NativeFeedback(name, axes)
        self._steering_rad = 0.0
        """Last steering angle, within the range of commands: motors switched off leave it there."""
        self._clear_wanted = False
        self._frames = list(_NOTHING)
        """Frames of the present tick, in the order of `FRAMES`."""
        steered = any(axis.takes is Takes.ANGLE for axis in axes)
        counts = max(axis.ticks_per_revolution for axis in axes)
        self._own = own = OwnNode(
            NODE_ID,
            name,
            drive_script(
                codec.dbc, needs.rate_hz, needs.command_timeout_ms, counts, steered=steered
            ),
            {frame: Sink(self._frames, place) for place, frame in enumerate(FRAMES)},
            codec,
            needs.notes,
            needs.heartbeat_timeout_ms * 1_000_000,
            needs.rate_hz,
            steered=steered,
        )
        self.host_frames = own.host_frames
        self.handlers: Mapping[int, Handler] = {
            **own.handlers,
            codec.emergency_stop_id: lambda _data, _stamp_ns: self._leave_latches(),
        }

    @property
    def reports(self) -> tuple[ActuatorFeedback, ...]:
        """The newest of each axis."""
        return self._feedback.reports

    @property
    def status(self) -> NodeStatus:
        """Whether it is there and in service, and why not."""
        return self._own.status

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now."""
        self._own.check(now_ns)
        frames = self._frames
        self._feedback.update(*frames)
        drive = frames[-1]
        if drive is not None:
            low_rad, high_rad = self._codec.steering_range_rad
            self._steering_rad = min(max(drive.steering_rad, low_rad), high_rad)
        frames[:] = _NOTHING

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:  # noqa: ARG002 - as of every drive
        """Send MotorCommand; its counter moves on only when the bus took it.

        "Motors off" carries the measured steering, whatever the command.
        """
        if self._clear_wanted:
            self._clear_wanted = False
            self._own.node.request(CLEAR_FAULTS)
        alive = self._alive
        encode = self._codec.encode_command
        outputs = [0.0, 0.0, self._steering_rad]
        if command.enable and command.values:
            outputs[2] = 0.0
            for place, channel, sign in self._channels:
                outputs[channel] = sign * command.values[place]
        try:
            data = encode(alive.value, command.enable, command.brake, *outputs)
        except (ValueError, OverflowError):
            self._notes.refused += 1
            data = encode(alive.value, 0, 1, 0.0, 0.0, self._steering_rad)
        # A counter that advanced without a frame would look like a lost frame to the drive.
        if send(self._codec.command_id, data):
            alive.advance()

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send the next frame of its node services; return whether there was one."""
        return self._own.serve(send, now_ns)

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Send the emergency stop."""
        self._leave_latches()
        return send(self._codec.emergency_stop_id, bytes((source,)))

    def clear_faults(self) -> None:
        """Ask it, by its object 0x2010, to leave its latched state.

        The request goes out after the next command, or not at all where the node is not in service:
        a waiting request could take effect unexpectedly.
        """
        self._clear_wanted = True

    def _leave_latches(self) -> None:
        """Drop a request to clear faults: it was made without knowledge of the emergency stop."""
        self._clear_wanted = False
        self._own.node.withdraw()
