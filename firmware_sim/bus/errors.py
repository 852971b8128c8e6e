"""Fault confinement of one node, and how SocketCAN reports it.

Source: ISO 11898-1:2015, clause 12.1.4 (the counting rules, quoted by their letter below);
Linux `include/uapi/linux/can/error.h` for the error messages; words as in FMI-LS-BUS
(Modelica), CAN: Bus Error and Status operations.
"""

from __future__ import annotations

import enum

from firmware_sim.bus.frame import ERROR_FLAG

WARNING_LIMIT = 96
PASSIVE_LIMIT = 128
BUS_OFF_LIMIT = 256
_COUNTER_MAX = 255


class BusError(enum.IntEnum):
    """Errors on the wire (FMI-LS-BUS, Bus Error codes)."""

    BIT_ERROR = 1
    BIT_STUFFING_ERROR = 2
    FORM_ERROR = 3
    CRC_ERROR = 4
    ACK_ERROR = 5
    BROKEN_ERROR = 6


class ErrorState(enum.IntEnum):
    """State of a node's controller. FMI-LS-BUS has no WARNING; ISO 11898-1 and Linux have."""

    ERROR_ACTIVE = 0
    ERROR_WARNING = 1
    ERROR_PASSIVE = 2
    BUS_OFF = 3


class ErrorClass(enum.IntFlag):
    """Class bits in the id of a SocketCAN error message (linux/can/error.h)."""

    CRTL = 0x004
    PROT = 0x008
    ACK = 0x020
    BUSOFF = 0x040
    BUSERROR = 0x080
    RESTARTED = 0x100
    CNT = 0x200


class Controller(enum.IntFlag):
    """data[1] of an error message of class CRTL."""

    RX_OVERFLOW = 0x01
    TX_OVERFLOW = 0x02
    RX_WARNING = 0x04
    TX_WARNING = 0x08
    RX_PASSIVE = 0x10
    TX_PASSIVE = 0x20
    ACTIVE = 0x40


_PROTOCOL_TYPE = {
    BusError.BIT_ERROR: 0x01,
    BusError.FORM_ERROR: 0x02,
    BusError.BIT_STUFFING_ERROR: 0x04,
    BusError.CRC_ERROR: 0x00,
    BusError.ACK_ERROR: 0x00,
    BusError.BROKEN_ERROR: 0x01,
}
_PROTOCOL_TRANSMITTER = 0x80
_LOCATION = {
    BusError.BIT_ERROR: 0x00,
    BusError.FORM_ERROR: 0x18,  # CRC delimiter
    BusError.BIT_STUFFING_ERROR: 0x00,
    BusError.CRC_ERROR: 0x08,  # CRC sequence
    BusError.ACK_ERROR: 0x19,  # acknowledge slot
    BusError.BROKEN_ERROR: 0x00,
}


def _level(counter: int) -> ErrorState:
    if counter < WARNING_LIMIT:
        return ErrorState.ERROR_ACTIVE
    return ErrorState.ERROR_WARNING if counter < PASSIVE_LIMIT else ErrorState.ERROR_PASSIVE


class ErrorCounters:
    """Transmit and receive error counter (TEC, REC) of one node, and the state they mean.

    The methods are the rules of ISO 11898-1; each changes the counters only.

    Attributes
    ----------
    tec, rec
        Error counters, 0..255. `tec` stays 255 in bus-off, which an overflow causes.
    bus_off
        Whether the node has left the bus. Only `reset` ends that.
    """

    __slots__ = ("bus_off", "rec", "tec")

    def __init__(self) -> None:
        self.tec = 0
        self.rec = 0
        self.bus_off = False

    @property
    def state(self) -> ErrorState:
        """Worst state of the two counters."""
        if self.bus_off:
            return ErrorState.BUS_OFF
        return max(_level(self.tec), _level(self.rec))

    @property
    def passive(self) -> bool:
        """Whether a counter is beyond 127: error flags are recessive, transmission is suspended."""
        return self.tec >= PASSIVE_LIMIT or self.rec >= PASSIVE_LIMIT

    def transmit_error(self) -> None:
        """Rule c, d, f: the transmitter of a faulty frame, TEC + 8; beyond 255 it is bus-off."""
        self.tec += 8
        if self.tec >= BUS_OFF_LIMIT:
            self.tec = _COUNTER_MAX
            self.bus_off = True

    def acknowledge_error(self) -> None:
        """Rule c, exception 1: no answer, not even an error flag.

        TEC + 8, but no more once passive: so a lone node waits at 128 and never goes bus-off.
        """
        if not self.passive:
            self.transmit_error()

    def receive_error(self) -> None:
        """Rule a: a receiver has seen an error, REC + 1."""
        self.rec = min(self.rec + 1, _COUNTER_MAX)

    def receive_error_first(self) -> None:
        """Rule b, e, f: dominant bits after this receiver's own error flag, REC + 8."""
        self.rec = min(self.rec + 8, _COUNTER_MAX)

    def transmitted(self) -> None:
        """Rule g: a frame sent and acknowledged, TEC - 1."""
        if self.tec:
            self.tec -= 1

    def received(self) -> None:
        """Rule h: a frame received without error: REC - 1, from passive back to 127."""
        if self.rec >= PASSIVE_LIMIT:
            self.rec = PASSIVE_LIMIT - 1
        elif self.rec:
            self.rec -= 1

    def reset(self) -> None:
        """Begin again error-active at 0, as after bus-off recovery."""
        self.tec = 0
        self.rec = 0
        self.bus_off = False

    def controller_flags(self) -> Controller:
        """Return data[1] as Linux's `can_change_state` sets it when the state has changed."""
        transmit, receive = _level(self.tec), _level(self.rec)
        worst = max(transmit, receive)
        if worst is ErrorState.ERROR_ACTIVE:
            return Controller.ACTIVE
        flags = Controller(0)
        if transmit is worst:
            passive = worst is ErrorState.ERROR_PASSIVE
            flags |= Controller.TX_PASSIVE if passive else Controller.TX_WARNING
        if receive is worst:
            passive = worst is ErrorState.ERROR_PASSIVE
            flags |= Controller.RX_PASSIVE if passive else Controller.RX_WARNING
        return flags


def bus_error_message(
    error: BusError, counters: ErrorCounters, *, is_sender: bool
) -> tuple[ErrorClass, bytearray]:
    """Return class bits and data of the SocketCAN error message for an error on the wire."""
    classes = ErrorClass.BUSERROR | ErrorClass.CNT
    data = bytearray(8)
    if error is BusError.ACK_ERROR:
        classes |= ErrorClass.ACK
    else:
        classes |= ErrorClass.PROT
        data[2] = _PROTOCOL_TYPE[error] | (_PROTOCOL_TRANSMITTER if is_sender else 0)
    data[3] = _LOCATION[error]
    data[6], data[7] = counters.tec, counters.rec
    return classes, data


def state_message(counters: ErrorCounters) -> tuple[ErrorClass, bytearray]:
    """Return class bits and data of the SocketCAN error message for a changed state.

    As Linux tells it: a controller that is bus-off counts no errors.
    """
    data = bytearray(8)
    if counters.bus_off:
        return ErrorClass.BUSOFF, data
    data[1] = counters.controller_flags()
    data[6], data[7] = counters.tec, counters.rec
    return ErrorClass.CRTL | ErrorClass.CNT, data


def restarted_message() -> tuple[ErrorClass, bytearray]:
    """Return class bits and data of the message after bus-off recovery."""
    return ErrorClass.RESTARTED, bytearray(8)


def overflow_message() -> tuple[int, bytes]:
    """Return id (with `ERROR_FLAG`) and data of the message that received frames were lost."""
    return ERROR_FLAG | ErrorClass.CRTL, bytes((0, Controller.RX_OVERFLOW, 0, 0, 0, 0, 0, 0))
