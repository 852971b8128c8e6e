"""Commissioning: what a node must prove and be told before it is started.

Each kind of node has a script, a generator that yields SDO transfers and gets their answers; what
it returns is what is wrong, in a sentence, or nothing. `Node` advances it from within the control
loop, one frame at a time, and starts over whenever the node boots or comes back after a silence.

What a script writes it reads back at once, and again once the node is operational: one that has
restarted in between, and whose boot-up message was lost, has forgotten it.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Final, TypeAlias

from robotctl.drivers.bus_load import STEERING_STATUS, SYNC, transmission_type
from robotctl.drivers.can_config import NodeParameters
from robotctl.drivers.dbc import Dbc
from robotctl.drivers.sdo import ABORT_NO_OBJECT, Request, Response


class Start(enum.Enum):
    """What a script yields, once, where the node is to become operational before it goes on."""

    START = "start"


Script: TypeAlias = Generator[Request | Start, Response, str]
"""Yields transfers, receives their ends, returns the problem ("" where there is none)."""

VENDOR_ID: Final = 0x00526F62
REVISION_MAJOR: Final = 0x0001
PRODUCT_DRIVE, PRODUCT_SONAR, PRODUCT_POWER = 1, 2, 3


@dataclass(frozen=True, slots=True)
class Setting:
    """An object that is given a value of `size` bytes; `unit` follows that in sentences."""

    index: int
    subindex: int
    name: str
    wanted: int
    size: int
    unit: str


CLEAR_FAULTS: Final = Request(0x2010, 0, "clear faults", value=1, size=1)


def drive_script(dbc: Dbc, parameters: NodeParameters) -> Callable[[], Script]:
    """Return the script of the motor controller.

    Identity, wire version, counts per revolution; then the command time-out and how often the
    status frames come.
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
            or (yield from _configure_and_start(ring_period))
        )

    return script


def power_script(dbc: Dbc, _: NodeParameters) -> Callable[[], Script]:
    """Return the script of the battery monitor: identity."""

    def script() -> Script:
        return (
            (yield from _identify(PRODUCT_POWER))
            or (yield from _wire_version(dbc.wire_version, optional=True))
            or (yield from _configure_and_start())
        )

    return script


def _identify(product: int) -> Script:
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


def _wire_version(ours: int, *, optional: bool = False) -> Script:
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


def _expect(request: Request, wanted: int, problem: str) -> Script:
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
        write = Request(setting.index, setting.subindex, setting.name, setting.wanted, setting.size)
        response = yield write
        if response.value is None:
            return _failure(write, response)
        if problem := (yield from _read_back(setting)):
            return problem
    yield Start.START
    for setting in settings:
        if problem := (yield from _read_back(setting)):
            return problem
    return ""


def _read_back(setting: Setting) -> Script:
    """Check that an object has the value that was written."""
    request = Request(setting.index, setting.subindex, setting.name)
    problem = f"{setting.name} reads back {{found}}{setting.unit}, wanted {{wanted}}{setting.unit}"
    return (yield from _expect(request, setting.wanted, problem))


def _failure(request: Request, response: Response) -> str:
    """Say that a transfer did not succeed."""
    if response.abort is None:
        return f"no answer to {request}"
    if response.abort == ABORT_NO_OBJECT:
        return f"refused {request}: it has no such object"
    return f"refused {request}: SDO abort 0x{response.abort:08X}"
