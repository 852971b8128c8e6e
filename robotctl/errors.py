"""The exceptions of robotctl: few, and each names what was found, where, and what was allowed."""

from __future__ import annotations

import errno
from typing import Final

DISK: Final = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO))
"""Errors of a disk that cannot take or give any more."""


class RobotctlError(Exception):
    """Base of all errors that robotctl raises on purpose."""


class ConfigError(RobotctlError):
    """A configuration file or an override is wrong; the message has one line for each error."""


class InvalidValue(ValueError):  # noqa: N818 - says which value, as ValueError does
    """A value breaks a rule of the object that is made with it.

    Parameters
    ----------
    key
        Its name in that object; with dots where it is deeper inside.
    rule
        What is allowed, and what was found, in words that may follow `KEY: `.
    value
        What was found.
    """

    def __init__(self, key: str, rule: str, value: object) -> None:
        super().__init__(key, rule, value)
        self.key = key
        self.rule = rule
        self.value = value

    def __str__(self) -> str:
        return f"{self.key} {self.rule}" if self.rule[:5] == "must " else f"{self.key}: {self.rule}"


class DiskError(RobotctlError):
    """The disk did not take what was to be written; no input is wrong."""


class LinkError(RobotctlError):
    """A bus, a MAVLink link or a local socket could not be opened."""


class MissionError(RobotctlError):
    """A mission file is wrong or cannot be driven by this robot."""


class CalibrationError(RobotctlError):
    """A calibration could not be carried out: too little in the data, or an experiment failed."""


class PlaceError(RobotctlError):
    """A place cannot be learnt or recognised: no turn on the spot, or too little was heard."""
