"""Commissioning: what a node must prove and be told before it is started.

Each kind of node has a script, a generator that yields SDO transfers and gets their answers; what
it returns is what is wrong, in a sentence, or the settings that must stay as they are. `Node`
advances it from within the control loop, one frame at a time, and starts over whenever the node
boots or comes back after a silence.

What a script writes it reads back at once, and again once the node is operational: one that has
restarted in between, and whose boot-up message was lost, has forgotten it. Limits that are the
node's own it reads only. From then on `Node` reads all of them in turn.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from robotctl.drivers.can.bus_load import STEERING_STATUS, SYNC, transmission_type
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import Dbc
from robotctl.drivers.can.nodes.sdo import ABORT_NO_OBJECT, Request, SdoResponse


class Start(enum.Enum):
    """What a script yields, once, where the node is to become operational before it goes on."""

    START = "start"


Check: TypeAlias = Generator[Request | Start, SdoResponse, str]
"""Yields transfers, receives their ends, returns the problem ("" where there is none)."""

Script: TypeAlias = Generator[Request | Start, SdoResponse, "str | tuple[Setting, ...]"]
"""A whole commissioning: returns the problem, or what must stay as it is."""

VENDOR_ID: Final = 0x00526F62
REVISION_MAJOR: Final = 0x0001
PRODUCT_DRIVE, PRODUCT_SONAR, PRODUCT_POWER = 1, 2, 3


@dataclass(frozen=True, slots=True)
class Setting:
    """An object that is given a value of `size` bytes; `unit` follows that in sentences.

    Where nothing is `wanted` it is a limit of the node's own, which must stay as it is found.
    """

    index: int
    subindex: int
    name: str
    wanted: int | None
    size: int
    unit: str

    @property
    def reading(self) -> Request:
        """The transfer that reads it."""
        return Request(self.index, self.subindex, self.name)

    @property
    def writing(self) -> Request:
        """The transfer that writes what is wanted."""
        return Request(self.index, self.subindex, self.name, self.wanted, self.size)

    def differs(self, found: int) -> str:
        """Say that it has another value than the one wanted."""
        return f"{self.name} reads back {found}{self.unit}, wanted {self.wanted}{self.unit}"


HEARTBEAT: Final = Setting(0x1017, 0, "heartbeat period", None, 2, " ms")

CLEAR_FAULTS: Final = Request(0x2010, 0, "clear faults", value=1, size=1)


def drive_script(dbc: Dbc, parameters: NodeParameters) -> Callable[[], Script]:
    """Return the script of the motor controller.

    Identity, wire version, counts per revolution; then the command time-out and how often the
    status frames come; its heartbeat and its own limits as they are.
    """
    sync = dbc.message(SYNC)
    motor_every, drive_every = (
        transmission_type(dbc.message(name), sync, parameters.rate_hz, steered=parameters.steered)
        for name in ("MotorStatus", STEERING_STATUS)
    )
    settings = (
        Setting(0x2000, 0, "command time-out", parameters.command_timeout_ms, 2, " ms"),
        Setting(0x1801, 2, "period of MotorStatus", motor_every, 1, " SYNC"),
        Setting(0x1802, 2, "period of DriveStatus", drive_every, 1, " SYNC"),
        HEARTBEAT,
        Setting(0x2003, 0, "current limit", None, 4, " mA"),
        Setting(0x2004, 0, "over-temperature limit", None, 1, " degC"),
        Setting(0x2005, 0, "under-voltage limit", None, 2, " mV"),
    )

    def script() -> Script:
        counts = parameters.counts_per_revolution
        return (
            (yield from _identify(PRODUCT_DRIVE))
            or (yield from _wire_version(dbc.wire_version))
            or (
                yield from _expect(
                    Request(0x2002, 0, "counts per revolution"),
                    counts,
                    "has {found} counts per revolution, the configuration says {wanted}",
                )
            )
            or (yield from _configure_and_start(*settings))
        )

    return script


def sonar_script(dbc: Dbc, parameters: NodeParameters) -> Callable[[], Script]:
    """Return the script of the sonar ring: identity, number of sonars, ring period of the DBC."""
    period_ms = dbc.message("SonarRangesA").cycle_ms
    ring_period = Setting(0x2201, 0, "ring period", period_ms, 2, " ms")

    def script() -> Script:
        return (
            (yield from _identify(PRODUCT_SONAR))
            or (yield from _wire_version(dbc.wire_version, optional=True))
            or (
                yield from _expect(
                    Request(0x2200, 0, "number of sonars"),
                    parameters.sonars,
                    "has {found} sonars, the configuration says {wanted}",
                )
            )
            or (yield from _configure_and_start(ring_period, HEARTBEAT))
        )

    return script


def power_script(dbc: Dbc, _: NodeParameters) -> Callable[[], Script]:
    """Return the script of the battery monitor: identity, heartbeat, its limits."""
    limits = (
        Setting(0x2300, 0, "low limit", None, 2, " mV"),
        Setting(0x2301, 0, "critical limit", None, 2, " mV"),
    )

    def script() -> Script:
        return (
            (yield from _identify(PRODUCT_POWER))
            or (yield from _wire_version(dbc.wire_version, optional=True))
            or (yield from _configure_and_start(HEARTBEAT, *limits))
        )

    return script


def _identify(product: int) -> Check:
    """Check the identity object 0x1018."""
    problem = yield from _expect(
        Request(0x1018, 1, "vendor"), VENDOR_ID, "vendor 0x{found:08X} is not ours 0x{wanted:08X}"
    )
    if problem:
        return problem
    problem = yield from _expect(
        Request(0x1018, 2, "product code"),
        product,
        "is another device: product code {found} instead of {wanted}",
    )
    if problem:
        return problem
    request = Request(0x1018, 3, "revision")
    response = yield request
    if response.value is None:
        return _failure(request, response)
    if response.value >> 16 != REVISION_MAJOR:
        return f"revision 0x{response.value:08X} is not 0x{REVISION_MAJOR:04X}xxxx"
    return ""


def _wire_version(ours: int, *, optional: bool = False) -> Check:
    """Check that the node speaks the same DBC; an `optional` version may be missing."""
    request = Request(0x2001, 0, "wire version")
    response = yield request
    if optional and response.abort == ABORT_NO_OBJECT:
        return ""
    if response.value is None:
        return _failure(request, response)
    if response.value != ours:
        return f"wire version 0x{response.value:08X} is not ours 0x{ours:08X}"
    return ""


def _expect(request: Request, wanted: int, problem: str) -> Check:
    """Read an object that must have the value `wanted`."""
    response = yield request
    if response.value is None:
        return _failure(request, response)
    if response.value != wanted:
        return problem.format(found=response.value, wanted=wanted)
    return ""


def _configure_and_start(*settings: Setting) -> Script:
    """Write objects and read them back, before the node is operational and again then."""
    for setting in settings:
        if setting.wanted is not None:
            response = yield setting.writing
            if response.value is None:
                return _failure(setting.writing, response)
            if problem := (yield from _read_back(setting)):
                return problem
    yield Start.START
    kept = []
    for setting in settings:
        response = yield setting.reading
        if setting.wanted is None and response.abort == ABORT_NO_OBJECT:
            continue  # a node without such a limit
        if response.value is None:
            return _failure(setting.reading, response)
        if setting.wanted not in (None, response.value):
            return setting.differs(response.value)
        kept.append(replace(setting, wanted=response.value))
    return tuple(kept)


def _read_back(setting: Setting) -> Check:
    """Check that an object has the value that was written."""
    response = yield setting.reading
    if response.value is None:
        return _failure(setting.reading, response)
    return "" if response.value == setting.wanted else setting.differs(response.value)


def _failure(request: Request, response: SdoResponse) -> str:
    """Say that a transfer did not succeed."""
    if response.abort is None:
        return f"no answer to {request}"
    if response.abort == ABORT_NO_OBJECT:
        return f"refused {request}: it has no such object"
    return f"refused {request}: SDO abort 0x{response.abort:08X}"
