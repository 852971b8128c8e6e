"""Dialects of CiA 402: what drives of one make have, lack, and count in, as data.

Sources. Objects, types and defaults of the ZLAC8015D: its EDS (NamPER221/base-canopen@abfab4d);
its halves (left low, right high), 0.1 rpm of 606Ch and 0.1 A of 6077h: public drivers of it;
that its event timers count 0.5 ms: the maker's quick start guide, as users cite it. Objects of
Roboteq: rock-drivers, motors_roboteq_canopen (Objects.hpp); RPM of 60FFh: CAN Networking Manual
2.0, table 4-37.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final

from robotctl.drivers.can.drives.cia402 import faults
from robotctl.drivers.can.drives.cia402.faults import Decode
from robotctl.drivers.can.drives.cia402.wire import Layout, Mapped, Pdo, Role
from robotctl.drivers.can.nodes.commissioning import Setting

AXIS_OFFSET: Final = 0x800
"""Distance of the objects of one axis from those of the next (CiA 402-2, 5.2)."""

I32_MAX: Final = 0x7FFF_FFFF


class Ramp(enum.Enum):
    """Meaning of 6083h, 6084h and 6085h."""

    RATE = "velocity units per second"
    TIME_MS = "time [ms]"
    UNKNOWN = "left as the maker's tool set it"


@dataclass(frozen=True, slots=True)
class Polled:
    """A value that no PDO carries, read by SDO now and then.

    Parameters
    ----------
    index, subindex, bits
        Which object; below 0 bits: signed.
    role
        `CURRENT` [A] or `VOLTAGE` [V]; None: a temperature [degC].
    scale
        Unit of the object.
    axis
        Place of its axis; None: it is that of all.
    """

    index: int
    subindex: int
    bits: int
    role: Role | None
    scale: float
    axis: int | None = None


@dataclass(frozen=True, slots=True)
class Dialect:
    """One make of drives.

    Parameters
    ----------
    axes
        Greatest number of axes of a node.
    decode_error
        Meaning of its error codes.
    objects
        Objects, by index, of those that not every drive has; None: its EDS must say.
    counts_per_turn
        Position units in one turn of the motor; 0: the robot's file must say.
    target_per_turn, actual_per_turn
        Velocity units for one turn per second; 0: the robot's file says.
    target_max
        Greatest target velocity that it takes [its unit].
    layout
        Its process data; None: the standard's, by what objects it has.
    event_per_ms
        Units of its event timers in a millisecond; 0: its PDOs come on SYNC.
    current_a
        Unit of the current that its PDOs carry [A]; 0: per mille of 6075h.
    voltage_v
        Unit of the voltage that its PDOs carry [V].
    error_object
        Where its error code is.
    ramp
        Meaning of its ramps.
    off_line_ms
        Index of the object with its own command time-out [ms]; 0: none.
    settings
        What is written besides.
    polled
        What is read now and then.
    sdo_pause_ms
        Least time between requests to its SDO server [ms].
    """

    axes: int
    decode_error: Decode
    objects: frozenset[int] | None = None
    counts_per_turn: int = 0
    target_per_turn: float = 0.0
    actual_per_turn: float = 0.0
    target_max: int = I32_MAX
    layout: Layout | None = None
    event_per_ms: int = 0
    current_a: float = 0.0
    voltage_v: float = 0.0
    error_object: int = 0x603F
    ramp: Ramp = Ramp.RATE
    off_line_ms: int = 0
    settings: tuple[Setting, ...] = ()
    polled: tuple[Polled, ...] = ()
    sdo_pause_ms: int = 15


_ZLAC_LAYOUT: Final = Layout(
    receive=(
        Pdo(
            1,
            (
                Mapped(0x6040, 0, 16, "H", ((Role.CONTROL, 0),)),
                Mapped(0x60FF, 3, 32, "hh", ((Role.TARGET, 0), (Role.TARGET, 1))),
            ),
        ),
    ),
    transmit=(
        Pdo(
            1,
            (
                Mapped(0x6041, 0, 32, "HH", ((Role.STATUS, 0), (Role.STATUS, 1))),
                Mapped(0x603F, 0, 32, "HH", ((Role.ERROR, 0), (Role.ERROR, 1))),
            ),
            every=0,
        ),
        Pdo(
            2,
            (
                Mapped(0x606C, 1, 32, "i", ((Role.SPEED, 0),)),
                Mapped(0x606C, 2, 32, "i", ((Role.SPEED, 1),)),
            ),
            every=0,
        ),
        Pdo(
            3,
            (
                Mapped(0x6064, 1, 32, "i", ((Role.POSITION, 0),)),
                Mapped(0x6064, 2, 32, "i", ((Role.POSITION, 1),)),
            ),
            every=0,
        ),
        Pdo(
            4,
            (
                Mapped(0x6077, 3, 32, "hh", ((Role.CURRENT, 0), (Role.CURRENT, 1))),
                Mapped(0x2035, 0, 16, "H", ((Role.VOLTAGE, 0),)),
            ),
            every=0,
        ),
    ),
)

DIALECTS: Final = {
    "generic": Dialect(
        axes=2,
        decode_error=faults.of_cia402,
        polled=(Polled(0x6079, 0, 32, Role.VOLTAGE, 0.001),),
    ),
    "zlac8015d": Dialect(
        axes=2,
        decode_error=faults.of_zlac8015d,
        objects=frozenset({0x603F, 0x6064, 0x606C, 0x6077, 0x6083, 0x6084, 0x6085, 0x60FF}),
        counts_per_turn=4096,
        target_per_turn=60.0,
        actual_per_turn=600.0,
        target_max=1000,
        layout=_ZLAC_LAYOUT,
        event_per_ms=2,
        current_a=0.1,
        voltage_v=0.01,
        ramp=Ramp.TIME_MS,
        off_line_ms=0x2000,
        settings=(Setting(0x200F, 0, "synchronous control", 1, 2, ""),),
        polled=(
            Polled(0x2032, 1, 16, None, 0.1, 0),
            Polled(0x2032, 2, 16, None, 0.1, 1),
        ),
    ),
    "roboteq": Dialect(
        axes=2,
        decode_error=faults.of_roboteq,
        objects=frozenset({0x2112, 0x6064, 0x606C, 0x60FF, 0x6042, 0x6044}),
        target_per_turn=60.0,
        actual_per_turn=60.0,
        error_object=0x2112,
        ramp=Ramp.UNKNOWN,
        polled=(
            Polled(0x2100, 1, -16, Role.CURRENT, 0.1, 0),
            Polled(0x2100, 2, -16, Role.CURRENT, 0.1, 1),
            Polled(0x210D, 2, 16, Role.VOLTAGE, 0.1),
            Polled(0x210F, 2, -8, None, 1.0),
        ),
    ),
}
"""All dialects, by the name that `dialect` has in a robot's file."""
