"""MANUAL_CONTROL and RC_CHANNELS_OVERRIDE: the sticks of a ground station, as ArduRover's.

z (throttle) drives, positive forward, and y turns, positive to the right; x and r are ignored, as
ArduRover ignores them (`handle_manual_control_axes` in Rover/GCS_MAVLink_Rover.cpp). A holonomic
robot moves sideways by r, positive to the right: the stick that is left over, since ground stations
turn a rover by y. Of all axes -1000 to 1000 is the whole travel and 0 is rest. An axis at 32767 is
not given: as one at rest. A throttle of 500 is half ahead, as on ArduRover, whatever lever a ground
station shows for it.

Of RC_CHANNELS_OVERRIDE channel 1 turns, channel 3 drives and channel 4 moves a holonomic robot
sideways, by ArduPilot's default calibration: 1100 to 1900 us with rest within 30 us of 1500. For
each of them 0 releases the channel, which is at rest at once, and 65535 leaves it as it is, until
it expires. (Channels 9 to 18, where 0 and 65535 leave a channel and 65534 releases it, steer
nothing.)

RC_CHANNELS tells the sticks of both in these pulses. In MANUAL it is said, once in a while, that
they have stopped coming and the robot brakes.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import UNKNOWN, Context
from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.vehicle.setpoints import SAY_AGAIN_NS
from robotctl.messages.control import ManualControl, Mode
from robotctl.messages.mavlink_port import Message, Peer
from robotctl.safety.state_machine import POWERED

NO_AXIS = frames.INT16_MAX
FULL = 1000
"""Full deflection of an axis of MANUAL_CONTROL."""

PULSES_US = range(800, 2201)
"""Pulses that a receiver gives [us]; others are mistakes."""
REST_US, DEAD_US, TRAVEL_US = 1500, 30, 400
CHANNELS, THROTTLE_CHANNEL, SIDEWAYS_CHANNEL = 18, 3, 4
_RELEASED, _UNCHANGED = 0, frames.UINT16_MAX
_OVERRIDE = common.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE


class _Stick(NamedTuple):
    """An axis of MANUAL_CONTROL, and when it is void [ns]."""

    axis: int
    expires_ns: int


_REST: Final = _Stick(0, 0)


class ManualControls(Microservice):
    """Turns sticks into requests that expire; `refused` counts messages out of range."""

    handles = frozenset({common.MAVLINK_MSG_ID_MANUAL_CONTROL, _OVERRIDE})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.refused = 0
        self._say_ns = self._say_lost_ns = 0
        self._throttle = self._steering = self._sideways = _REST
        self._expires_ns: int | None = None
        """When the first of them is void that is not [ns]."""

    def streams(self) -> tuple[Stream, ...]:
        """Return RC_CHANNELS, which is off."""
        group = common.MAV_DATA_STREAM_RC_CHANNELS
        return (Stream(common.MAVLINK_MSG_ID_RC_CHANNELS, self._channels, 0.0, group),)

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """Take one position of the sticks."""
        if message.get_msgId() == _OVERRIDE:
            across_us = message.chan4_raw if self._context.robot.holonomic else _UNCHANGED
            self._take_channels(message.chan3_raw, message.chan1_raw, across_us, now_ns)
            return
        # MANUAL_CONTROL names its target in a field of its own.
        if message.target not in (0, self._context.config.system_id):
            return
        given = {"z": message.z, "y": message.y}
        if self._context.robot.holonomic:
            given["r"] = message.r
        axes = [0 if axis == NO_AXIS else axis for axis in given.values()]
        if max(map(abs, axes)) > FULL:
            found = ", ".join(f"{name} {axis}" for name, axis in given.items())
            self._refuse(f"{found}: allowed -{FULL} to {FULL}", now_ns)
            return
        expires_ns = now_ns + self._context.setpoint_life_ns
        sticks = [_Stick(axis, expires_ns) for axis in axes]
        self._throttle, self._steering, self._sideways = (*sticks, _REST)[:3]
        self._drive(now_ns)

    def _take_channels(
        self, throttle_us: int, steering_us: int, across_us: int, now_ns: int
    ) -> None:
        """Take the pulses of three channels [us]."""
        pulses_us = {throttle_us, steering_us, across_us}
        given = pulses_us - {_RELEASED, _UNCHANGED}
        if any(each not in PULSES_US for each in given):
            found = f"channels 3 {throttle_us}, 1 {steering_us}"
            if self._context.robot.holonomic:
                found += f", 4 {across_us}"
            self._refuse(f"{found}: allowed {PULSES_US[0]} to {PULSES_US[-1]}", now_ns)
        elif given or (_RELEASED in pulses_us and self._expires_ns is not None):
            expires_ns = now_ns + self._context.setpoint_life_ns
            self._throttle = _channel(throttle_us, self._throttle, expires_ns)
            self._steering = _channel(steering_us, self._steering, expires_ns)
            self._sideways = _channel(across_us, self._sideways, expires_ns)
            self._drive(now_ns)

    def _refuse(self, why: str, now_ns: int) -> None:
        """Count sticks that are no sticks, and say so once in a while."""
        self.refused += 1
        if now_ns >= self._say_ns:
            self._say_ns = now_ns + SAY_AGAIN_NS
            self._context.say(now_ns, f"Sticks: {why}")

    def _drive(self, now_ns: int) -> None:
        """Ask for what the sticks say; one that is void is at rest."""
        sticks = (self._throttle, self._steering, self._sideways)
        throttle, steering, right = (
            each.axis if each.expires_ns > now_ns else 0 for each in sticks
        )
        expiries = [each.expires_ns for each in sticks if each.expires_ns > now_ns]
        self._expires_ns = min(expiries, default=None)
        expires_ns = self._expires_ns or now_ns + self._context.setpoint_life_ns
        turn = frames.stick_turn(steering)
        forward, left = frames.base_from_frd(throttle / FULL, right / FULL)
        self._context.requests.append(ManualControl(now_ns, expires_ns, forward, turn, left))

    def _channels(self, now_ns: int) -> list[Message]:
        """Return RC_CHANNELS: the sticks as pulses of their channels [us], while they count."""
        channels = [frames.UINT16_MAX] * CHANNELS
        for place, stick in ((0, self._steering), (2, self._throttle), (3, self._sideways)):
            if stick.expires_ns > now_ns:
                channels[place] = _pulse_us(stick.axis)
        most = SIDEWAYS_CHANNEL if self._context.robot.holonomic else THROTTLE_CHANNEL
        count = 0 if self._expires_ns is None else most
        return [
            common.MAVLink_rc_channels_message(frames.boot_ms(now_ns), count, *channels, UNKNOWN)
        ]

    def step(self, now_ns: int) -> None:
        """Let the stick that is not void go on alone; say that no sticks come any more."""
        if self._expires_ns is None or now_ns < self._expires_ns:
            return
        self._expires_ns = None
        sticks = (self._throttle, self._steering, self._sideways)
        if max(each.expires_ns for each in sticks) > now_ns:
            self._drive(now_ns)
            return
        control = self._context.fresh_control(now_ns)
        is_driven = control is not None and control.state in POWERED
        is_driven &= self._context.mode(now_ns) is Mode.MANUAL
        if is_driven and now_ns >= self._say_lost_ns:
            self._say_lost_ns = now_ns + SAY_AGAIN_NS
            self._context.say(now_ns, "Sticks: lost, the robot brakes")


def _channel(pulse_us: int, before: _Stick, expires_ns: int) -> _Stick:
    """Return a stick as a channel [us] sets, releases or leaves it."""
    if pulse_us == _UNCHANGED:
        return before
    return _REST if pulse_us == _RELEASED else _Stick(_axis(pulse_us), expires_ns)


def _axis(pulse_us: int) -> int:
    """Return a channel as an axis of MANUAL_CONTROL."""
    off_us = pulse_us - REST_US
    beyond_us = min(max(abs(off_us) - DEAD_US, 0), TRAVEL_US - DEAD_US)
    share = beyond_us / (TRAVEL_US - DEAD_US)
    return round(math.copysign(share * FULL, off_us))


def _pulse_us(axis: int) -> int:
    """Return the pulse that means an axis of MANUAL_CONTROL."""
    share = axis / FULL
    off_us = math.copysign(DEAD_US, share) + share * (TRAVEL_US - DEAD_US) if axis else 0.0
    return round(REST_US + off_us)
