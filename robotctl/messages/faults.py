"""Faults: why a robot stops or does not arm, as a code for programs and a text for people."""

from __future__ import annotations

import enum

import msgspec


class FaultCode(enum.IntEnum):
    """Kinds of faults. Numbers never change, since logs contain them.

    The comments name those that only prevent arming.

    docs/safety.md has the message, detection time and remedy of each.
    """

    NONE = 0

    # The bus.
    BUS_OFF = 10
    BUS_DOWN = 11
    BUS_PASSIVE = 12  # prevents arming
    BUS_FULL = 13  # prevents arming
    BUS_STRANGER = 14
    BUS_ERRORS = 15
    BUS_BLOCKED = 16
    BUS_SILENT = 17

    # Inputs that are missing or too old.
    WHEELS_STALE = 20
    MOTOR_STALE = 21
    DRIVE_STALE = 22
    BATTERY_STALE = 23
    BATTERY_MISSING = 24
    SONAR_STALE = 25
    IMU_STALE = 26

    # This computer.
    CONTROL_HELD_UP = 30
    COMMAND_GUARD = 31
    RIGHT_MISSING = 32  # prevents arming
    NOT_WARM = 33  # prevents arming
    NO_GAINS = 34  # prevents arming

    # Reports of the motor controller.
    COMMAND_LOSS = 40
    DRIVE_NOT_ENABLED = 41
    DRIVE_STOPPED = 42
    DRIVE_EMERGENCY_STOP = 43
    DRIVE_FAULT = 44
    DRIVE_OVER_CURRENT = 45
    DRIVE_OVER_TEMPERATURE = 46
    DRIVE_UNDER_VOLTAGE = 47
    DRIVE_ENCODER = 48
    DRIVE_COMMAND_TIMEOUT = 49
    DRIVE_PARAMETER = 50
    DRIVE_OVER_VOLTAGE = 51
    DRIVE_UNREADABLE = 52
    DRIVE_UNPROVEN = 53  # prevents arming

    # The battery.
    BATTERY_CRITICAL = 60
    BATTERY_LOW = 61  # prevents arming

    # Nodes on the bus.
    NODE_NOT_HEARD = 70
    NODE_SILENT = 71
    NODE_STARTING = 72
    NODE_REFUSED = 73
    NODE_CHANGED = 74
    NODE_PUT_OUT = 75
    NODE_RESTARTED = 76
    NODE_NO_ANSWER = 77
    NODE_OTHER_DEVICE = 78
    NODE_OTHER_FIRMWARE = 79

    # Emergency stops.
    EMERGENCY_STOP = 80
    EMERGENCY_STOP_BUS = 81
    DRIVES_UNASKED = 82

    # Nodes on the bus, continued.
    NODE_OTHER_VALUE = 90
    NODE_DOUBLED = 91
    NODE_MISREPORTED = 92

    # Inputs that contradict each other.
    ENCODER_STUCK = 100
    ENCODER_REVERSED = 101
    ENCODERS_SWAPPED = 102
    ENCODER_WRONG = 103
    ENCODER_JUMPS = 104
    WHEELS_CONTRADICT = 105
    WHEEL_BLOCKED = 106
    WHEEL_PUSHES = 107
    STEERING_OFF = 108
    CLOCK_DRIFT = 109
    WHEEL_ASTRAY = 110
    WHEELS_SLIP = 120
    SONAR_STUCK = 121
    ODOMETRY_REVERSED = 122
    ROBOT_TILTED = 123
    PICKED_UP = 124
    IMU_STUCK = 125
    GYRO_CONTRADICTS = 126

    # Values that no healthy sensor gives: they prevent arming.
    TEMPERATURE_WRONG = 130
    CURRENT_WRONG = 131
    SUPPLY_WRONG = 132
    STEERING_WRONG = 133

    # Requests to arm that fail on their own.
    REQUEST_TOO_OLD = 140
    REQUEST_TOO_EARLY = 141
    REQUEST_BEFORE_STOP = 142
    REQUEST_WITHDRAWN = 143
    NOT_READY = 144


class Fault(msgspec.Struct, frozen=True):
    """One fault.

    Parameters
    ----------
    code
        Its kind.
    text
        Sentence for people, with the values found; also `str(fault)`.
    part
        Name of the node, wheel or sonar concerned; empty if none in particular.
    """

    code: FaultCode
    text: str
    part: str = ""

    def __str__(self) -> str:
        """Return the text."""
        return self.text
