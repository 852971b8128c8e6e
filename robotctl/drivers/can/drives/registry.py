"""`DRIVES`: every kind of motor drive, by the class of its table `[[motor]]`."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.cia402.config import Cia402Motor
from robotctl.drivers.can.drives.moteus.config import MoteusMotor
from robotctl.drivers.can.drives.motor_drive import MotorConfig
from robotctl.drivers.can.drives.native.config import NativeMotor
from robotctl.drivers.can.drives.odrive.config import ODriveMotor
from robotctl.drivers.can.drives.vesc.config import VescMotor

DRIVES: Final[tuple[type[MotorConfig], ...]] = (
    NativeMotor,
    Cia402Motor,
    ODriveMotor,
    VescMotor,
    MoteusMotor,
)
