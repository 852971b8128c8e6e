"""Errors of an ODrive: the messages that tell them, and whether the latch may be left."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.drivers.can.drives.interlock import Interlock
from robotctl.drivers.can.drives.odrive import faults, wire
from robotctl.messages.actuators import NEVER_NS, DriveState
from robotctl.messages.faults import Fault, FaultCode

STALE_NS: Final = 10_000_000
"""Time after clearing within which a received error may be from before [ns]."""

_NONE: Final = (0, 0, 0, 0)


class Errors:
    """Latches the errors that a drive tells until they are cleared.

    Parameters
    ----------
    part
        Name of the drive.
    interlock
        The latch.
    unreadable
        Takes name, data and reason of a message that says nothing.
    explain
        Takes a fault that is nearer to the cause than what the host found.

    Attributes
    ----------
    is_old
        Whether the firmware is 0.5; None: it is not known.
    """

    __slots__ = (
        "_cleared_ns",
        "_explain",
        "_interlock",
        "_is_clearing",
        "_part",
        "_told",
        "_unreadable",
        "is_old",
    )

    def __init__(
        self,
        part: str,
        interlock: Interlock,
        unreadable: Callable[[str, bytes, str], None],
        explain: Callable[[Fault], None],
    ) -> None:
        self._part, self._interlock = part, interlock
        self._unreadable, self._explain = unreadable, explain
        self.is_old: bool | None = None
        self._told = _NONE
        """Errors of axis, motor, encoder and controller; with 0.6 only the first."""
        self._is_clearing = False
        """Whether the next heartbeat decides about the latch."""
        self._cleared_ns = NEVER_NS

    def on_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of 0.6, or of the motor of 0.5."""
        if self.is_old is None or not self._is_whole("error", data, stamp_ns):
            return
        if self.is_old:
            self._add(motor=wire.LONG_ERRORS.unpack(data)[0])
        else:
            active, reason = wire.ERRORS.unpack(data)
            self._add(axis=(active | reason) & ~faults.INITIALIZING)

    def on_encoder_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of the encoder of 0.5."""
        if self.is_old and self._is_whole("encoder error", data, stamp_ns):
            self._add(encoder=wire.ERRORS.unpack(data)[0])

    def on_controller_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of the controller of 0.5."""
        if self.is_old and self._is_whole("controller error", data, stamp_ns):
            self._add(controller=wire.ERRORS.unpack(data)[0])

    def judge(self, error: int, stamp_ns: int, *, flagged: bool = False) -> None:
        """Latch the errors in a heartbeat; with none, unlatch after a clearing.

        Parameters
        ----------
        error
            Errors of the axis.
        stamp_ns
            Reception [ns].
        flagged
            Whether 0.5 has an error of motor, encoder or controller: which one is asked for.
        """
        if self._is_stale(stamp_ns):
            return
        if error:
            self._add(axis=error)
        elif flagged and self._told == _NONE:
            text = "the ODrive reports an error of motor, encoder or controller"
            self._interlock.hold(DriveState.FAULT, FaultCode.DRIVE_FAULT, text)
        if self._is_clearing:
            self._is_clearing = False
            if not (error or flagged or self._told != _NONE):
                self._interlock.clear()

    def clear(self, now_ns: int) -> None:
        """Forget all errors: the drive was just asked to [ns]."""
        self._told = _NONE
        self._is_clearing, self._cleared_ns = True, now_ns

    def keep(self) -> None:
        """Keep the latch, although the drive was asked to clear its errors."""
        self._is_clearing = False

    def _is_stale(self, stamp_ns: int) -> bool:
        """Return whether a message received at a time [ns] may be older than the clearing."""
        return stamp_ns - self._cleared_ns <= STALE_NS

    def _is_whole(self, name: str, data: bytes, stamp_ns: int) -> bool:
        """Return whether a message about errors is to be judged."""
        if len(data) != 8:
            self._unreadable(name, data, "it has 8 bytes")
            return False
        return not self._is_stale(stamp_ns)

    def _add(self, *, axis: int = 0, motor: int = 0, encoder: int = 0, controller: int = 0) -> None:
        """Latch errors of the drive.

        With 0.6, `axis` are the active errors and the reason of disarming. With 0.5 those of motor,
        encoder and controller are nearer to the cause than the axis's.
        """
        known = self._told
        told = (known[0] | axis, known[1] | motor, known[2] | encoder, known[3] | controller)
        if told == known:
            return
        self._told = told
        if self.is_old:
            sections: tuple[faults.Section, ...] = (
                ("motor ", told[1], faults.MOTOR_05),
                ("encoder ", told[2], faults.ENCODER_05),
                ("controller ", told[3], faults.CONTROLLER_05),
                ("axis ", told[0], faults.AXIS_05),
            )
        else:
            sections = (("", told[0], faults.ERRORS_06),)
        self._explain(faults.reported_fault(sections, self._part))
