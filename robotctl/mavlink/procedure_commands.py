"""Procedures that PREFLIGHT_CALIBRATION and DO_MOTOR_TEST ask for."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.core.motor_test import LONGEST_NS
from robotctl.mavlink.command import DENIED, UNSUPPORTED, Command

CALIBRATION: Final[int] = common.MAV_CMD_PREFLIGHT_CALIBRATION
MOTOR_TEST: Final[int] = common.MAV_CMD_DO_MOTOR_TEST

_OTHERS: Final = (
    "",
    "the robot has no magnetometer",
    "the robot has no barometer",
    "sticks need no calibration, they are -1000 to 1000",
    "the accelerometer needs none: its scale is learned at rest",
    "the robot has neither a compass nor an airspeed sensor",
    "the motor controllers are set up with `robotctl tune`",
)
"""Why param2 to param7 of PREFLIGHT_CALIBRATION calibrate nothing."""

_PERCENT: Final[int] = common.MOTOR_TEST_THROTTLE_PERCENT
_PWM: Final[int] = common.MOTOR_TEST_THROTTLE_PWM
_PILOT: Final[int] = common.MOTOR_TEST_THROTTLE_PILOT
_COMPASS: Final[int] = common.MOTOR_TEST_COMPASS_CAL
_PWM_MIN_US, _PWM_REST_US, _PWM_MAX_US = 1000.0, 1500.0, 2000.0


class Refusal(NamedTuple):
    """A MAV_RESULT, and why."""

    result: int
    why: str


class Turn(NamedTuple):
    """A wheel, from 0; share of the supply [-1, 1], positive forwards; how long [ns]."""

    wheel: int
    effort: float
    duration_ns: int


def asks_for_nothing(command: Command, turn: Turn | None) -> bool:
    """Say whether a command ends what is under way: no throttle, or nothing to calibrate."""
    if turn is not None:
        return turn.effort == 0.0
    return not any(command.params)


def not_a_gyro(command: Command, *, has_imu: bool) -> Refusal | None:
    """Return why a PREFLIGHT_CALIBRATION is not one of the gyro; None if it is, or is none."""
    given = [0.0 if math.isnan(value) else value for value in command.params]
    wanted = [index for index, value in enumerate(given) if value]
    if not wanted and any(map(math.isnan, command.params)):
        return Refusal(DENIED, "nothing to calibrate, 1 in param1 is the gyro")
    if len(wanted) > 1:
        return Refusal(DENIED, "one kind at a time")
    if wanted and wanted[0] > 0:
        return Refusal(UNSUPPORTED, _OTHERS[wanted[0]])
    if wanted and command.params[0] != 1.0:
        return Refusal(UNSUPPORTED, f"{command.params[0]:g} found in param1, 1 (gyro) allowed")
    if wanted and not has_imu:
        return Refusal(UNSUPPORTED, "the robot has no gyro")
    return None


def motor_test(command: Command, wheels: int) -> Turn | Refusal:
    """Return what a DO_MOTOR_TEST asks a robot with so many driven wheels for.

    param1 is the wheel, from 1; param2 whether param3, the throttle, is in percent (-100 to 100) or
    microseconds (1000 to 2000, 1500 is rest); param4 the time [s].
    """
    first, kind, throttle, seconds = command.params[:4]
    if _PILOT <= kind <= _COMPASS:
        return Refusal(UNSUPPORTED, "param2: percent (0) or PWM (1) allowed")
    if kind == _PERCENT and abs(throttle) <= 100.0:
        effort = throttle / 100.0
    elif kind == _PWM and _PWM_MIN_US <= throttle <= _PWM_MAX_US:
        effort = (throttle - _PWM_REST_US) / (_PWM_MAX_US - _PWM_REST_US)
    else:
        return Refusal(
            DENIED,
            f"throttle {throttle:g} of type {kind:g} found, "
            f"-100 to 100 % (0) or {_PWM_MIN_US:g} to {_PWM_MAX_US:g} us (1) allowed",
        )
    if effort == 0.0:
        return Turn(0, 0.0, 0)
    if command.params[4] > 1.0:
        return Refusal(UNSUPPORTED, "param5: one wheel at a time")
    if command.whole(0) not in range(1, wheels + 1):
        return Refusal(DENIED, f"motor {first:g} found, 1 to {wheels} allowed")
    if not 0.0 < seconds <= LONGEST_NS / 1e9:
        return Refusal(DENIED, f"{seconds:g} s found in param4, up to {LONGEST_NS / 1e9:g} allowed")
    return Turn(int(first) - 1, effort, round(seconds * 1e9))
