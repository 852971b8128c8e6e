"""Commissioning: the checks and settings of a node before it is started.

Each kind of node has a script, a generator that yields SDO transfers and gets their answers; what
it returns is what is wrong, or the settings that must stay as they are. `Node`
advances it from within the control loop, one frame at a time, and starts over whenever the node
boots or comes back after a silence.

What a script writes it reads back at once, and again once the node is operational: one that has
restarted in between, and whose boot-up message was lost, has forgotten it. Limits that are the
node's own it reads only. From then on `Node` reads all of them in turn.
"""

from __future__ import annotations

import enum
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from robotctl.drivers.can.nodes.sdo import ABORT_NO_OBJECT, Request, SdoResponse
from robotctl.messages.faults import Fault, FaultCode


class Start(enum.Enum):
    """Yielded once by a script when the node must become operational before it continues."""

    START = "start"


Check: TypeAlias = Generator[Request | Start, SdoResponse, Fault | None]
"""Yields transfers, receives their results, returns the problem."""

Script: TypeAlias = Generator[Request | Start, SdoResponse, "Fault | tuple[Setting, ...]"]
"""A whole commissioning: returns the problem, or the settings to read back."""

VENDOR_ID: Final = 0x00526F62
"""Vendor of our nodes (object 1018h, 1): "Rob" in ASCII."""


class Product(enum.IntEnum):
    """Product codes of our own nodes (object 1018h, 2)."""

    MOTOR_CONTROLLER = 1
    SONAR_RING = 2
    POWER = 3
    IMU = 4


REVISION_MAJOR: Final = 0x0001
"""Major revision of their protocol (object 1018h, 3)."""


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
        """The transfer that writes the wanted value."""
        return Request(self.index, self.subindex, self.name, self.wanted, self.size)

    def differs(self, found: int, code: FaultCode = FaultCode.NODE_OTHER_VALUE) -> Fault:
        """Return the text that it has another value than wanted."""
        text = f"{self.name} reads back {found}{self.unit}, wanted {self.wanted}{self.unit}"
        return Fault(code, text)


HEARTBEAT: Final = Setting(0x1017, 0, "heartbeat period", None, 2, " ms")


def identify(product: int) -> Check:
    """Check the identity object 0x1018."""
    problem = yield from expect(
        Request(0x1018, 1, "vendor"),
        VENDOR_ID,
        "vendor 0x{found:08X} is not ours 0x{wanted:08X}",
        FaultCode.NODE_OTHER_DEVICE,
    )
    if problem:
        return problem
    problem = yield from expect(
        Request(0x1018, 2, "product code"),
        product,
        "is another device: product code {found} instead of {wanted}",
        FaultCode.NODE_OTHER_DEVICE,
    )
    if problem:
        return problem
    request = Request(0x1018, 3, "revision")
    response = yield request
    if response.value is None:
        return failure(request, response)
    if response.value >> 16 != REVISION_MAJOR:
        text = f"revision 0x{response.value:08X} is not 0x{REVISION_MAJOR:04X}xxxx"
        return Fault(FaultCode.NODE_OTHER_FIRMWARE, text)
    return None


def same_wire(ours: int, *, optional: bool = False) -> Check:
    """Check that the node speaks the same DBC; an `optional` version may be missing."""
    request = Request(0x2001, 0, "wire version")
    response = yield request
    if optional and response.abort == ABORT_NO_OBJECT:
        return None
    if response.value is None:
        return failure(request, response)
    if response.value != ours:
        text = f"wire version 0x{response.value:08X} is not ours 0x{ours:08X}"
        return Fault(FaultCode.NODE_OTHER_FIRMWARE, text)
    return None


def expect(
    request: Request, wanted: int, text: str, code: FaultCode = FaultCode.NODE_OTHER_VALUE
) -> Check:
    """Read an object that must have the value `wanted`; `text` says that it has another."""
    response = yield request
    if response.value is None:
        return failure(request, response)
    if response.value != wanted:
        return Fault(code, text.format(found=response.value, wanted=wanted))
    return None


def configure_and_start(*settings: Setting) -> Script:
    """Write objects and read them back, before the node is operational and again then."""
    for setting in settings:
        if setting.wanted is not None and (problem := (yield from write(setting))):
            return problem
    yield Start.START
    kept = []
    for setting in settings:
        response = yield setting.reading
        if setting.wanted is None and response.abort == ABORT_NO_OBJECT:
            continue  # a node without such a limit
        if response.value is None:
            return failure(setting.reading, response)
        if setting.wanted not in (None, response.value):
            return setting.differs(response.value)
        kept.append(replace(setting, wanted=response.value))
    return tuple(kept)


def write(setting: Setting) -> Check:
    """Give an object the wanted value, and check that it has it."""
    response = yield setting.writing
    if response.value is None:
        return failure(setting.writing, response)
    response = yield setting.reading
    if response.value is None:
        return failure(setting.reading, response)
    return None if response.value == setting.wanted else setting.differs(response.value)


def failure(request: Request, response: SdoResponse) -> Fault:
    """Say that a transfer did not succeed."""
    if response.abort is None:
        return no_answer(request)
    if response.abort == ABORT_NO_OBJECT:
        text = f"refused {request}: it has no such object"
        return Fault(FaultCode.NODE_OTHER_FIRMWARE, text)
    reads = request.value is None
    code = FaultCode.NODE_OTHER_FIRMWARE if reads else FaultCode.NODE_OTHER_VALUE
    return Fault(code, f"refused {request}: SDO abort 0x{response.abort:08X}")


def no_answer(request: Request) -> Fault:
    """Say that nothing came back."""
    return Fault(FaultCode.NODE_NO_ANSWER, f"no answer to {request}")
