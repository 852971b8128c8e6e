"""A ground station made of pymavlink's own connection: an independent peer."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

from hil_tests.rig import Rig
from robotctl.messages.control import SafetyState

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

mavlink = mavutil.mavlink
BODY_VELOCITY = 0b0000_0111_1100_0111
"""Of SET_POSITION_TARGET_LOCAL_NED only velocity, and yaw rate, are used."""
POSITION = 0b0000_1111_1111_1000
"""Of SET_POSITION_TARGET_LOCAL_NED only the position is used."""


class GroundStation:
    """A `mavutil` connection that keeps its heartbeat up while it waits."""

    def __init__(self, rig: Rig, port: int) -> None:
        self.rig = rig
        self.link = mavutil.mavlink_connection(
            f"tcp:127.0.0.1:{port}", source_system=255, source_component=190, retries=20
        )

    def begin_anew(self) -> None:
        """Disarm the robot if it is armed, and forget what it has said."""
        self.rig.listen()
        if self.rig.control.state != SafetyState.STANDBY:
            self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
            self.rig.wait_for_state(SafetyState.STANDBY)
        self.rig.at_rest()
        while self.link.recv_match() is not None:
            pass

    def wait(self, kind: str, accept: Callable[[object], bool] = lambda _: True, seconds=5.0):
        deadline_s = time.monotonic() + seconds
        beat_s = 0.0
        while time.monotonic() < deadline_s:
            if time.monotonic() - beat_s > 0.5:
                beat_s = time.monotonic()
                self.link.mav.heartbeat_send(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0
                )
            message = self.link.recv_match(type=kind, blocking=True, timeout=0.1)
            if message is not None and accept(message):
                return message
        raise AssertionError(f"no such {kind} within {seconds} s")

    def command(self, number: int, *params: float) -> int:
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.link.mav.command_long_send(1, 1, number, 0, *padded)
        return self.wait("COMMAND_ACK", lambda ack: ack.command == number).result

    def drive_to(self, x_m: float, y_m: float) -> None:
        """Send the robot to a point of `world`."""
        north_m, east_m = y_m, x_m
        self.link.mav.set_position_target_local_ned_send(
            0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, POSITION, north_m, east_m, *(0,) * 9
        )

    def velocity(self, forward_m_s: float, yaw_rate_rad_s: float, seconds: float) -> None:
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            self.link.mav.set_position_target_local_ned_send(
                0,
                1,
                1,
                mavlink.MAV_FRAME_BODY_NED,
                BODY_VELOCITY,
                0,
                0,
                0,
                forward_m_s,
                0,
                0,
                0,
                0,
                0,
                0,
                yaw_rate_rad_s,
            )
            time.sleep(0.1)
            self.rig.listen()
