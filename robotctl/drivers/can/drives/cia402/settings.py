"""Commissioning of a CiA 402 drive: what is checked, written, read back and kept.

First the heartbeat, or the host would not know that the drive is still there; power off; the PDOs;
only then, by process data, the state machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from robotctl.drivers.can.drives.cia402.device import PROFILE_VELOCITY, VELOCITY, Device, Silence
from robotctl.drivers.can.drives.cia402.dialects import Ramp
from robotctl.drivers.can.drives.cia402.wire import RPDO_BASES, TPDO_BASES, Layout, Pdo, Role
from robotctl.drivers.can.nodes.commissioning import (
    Check,
    Script,
    Setting,
    Start,
    configure_and_start,
    expect,
    failure,
    write,
)
from robotctl.drivers.can.nodes.sdo import ABORT_NO_OBJECT, Request, SdoResponse
from robotctl.messages.faults import Fault, FaultCode

PROFILE: Final = 402
_INVALID: Final = 0x8000_0000
_NO_RTR: Final = 0x4000_0000
_BY_EVENT: Final = 0xFF
"""Device profile; bits of a COB-ID (not valid, no RTR) and transmission type by event (CiA 301,
7.5.2)."""

RAMP_S: Final = 0.1
"""Time from rest to the greatest speed by the drive's ramp: the host's limiter is slower [s]."""
STOP_S: Final = 0.2
"""Time from the greatest speed to rest by the quick-stop ramp [s]."""

GUARD_FACTOR: Final = 2
"""Life time factor: times that the guard time may pass without a request."""

BRAKING: Final = (3, 2, 1)
"""Stop options in the order in which they are tried: at the current limit, by the quick-stop ramp,
by the deceleration ramp; each ends without power (CiA 402-2, 605Ah and 605Eh)."""

_FAULT_SIGNAL: Final = 1
"""Abort connection option: the drive goes through its fault reaction into fault."""
_STAY, _STOP_NODE = 1, 2
"""Error behaviour 1029h: no change of the NMT state; stopped."""

_MODE_READINGS: Final = 10
"""Maximum readings until a drive shows the wanted mode."""

_Preferred: TypeAlias = Generator[Request | Start, SdoResponse, "Fault | Setting"]


@dataclass(slots=True)
class FoundDrive:
    """Results of a run of the script.

    Attributes
    ----------
    proof
        Settings for a silent host, in words; None: not known yet.
    rated_a
        Rated current of each axis [A]; 0: not told.
    is_mapped
        Whether the PDOs are configured.
    """

    proof: str | None = None
    rated_a: list[float] = field(default_factory=list)
    is_mapped: bool = False


@dataclass(frozen=True, slots=True)
class DriveSetup:
    """How a drive is to be set.

    Parameters
    ----------
    node_id
        Its number.
    device
        What it has.
    layout
        Its process data.
    heartbeat_ms
        Period of its heartbeat [ms].
    timeout_ms
        Time without the host after which it must stop [ms].
    host_id
        Node id by which the host sends its heartbeat.
    period_us
        Period of the host's ticks [us].
    fastest
        Greatest target velocity of each axis [its unit].
    """

    node_id: int
    device: Device
    layout: Layout
    heartbeat_ms: int
    timeout_ms: int
    host_id: int
    period_us: int
    fastest: tuple[float, ...]


def heartbeat_of(plan: DriveSetup) -> Setting | None:
    """Return the setting of the drive's own heartbeat.

    None with node guarding, which it would switch off (CiA 301, 7.2.8.2): its answers are as good.
    """
    if plan.device.silence is Silence.GUARDING:
        return None
    return Setting(0x1017, 0, "heartbeat period", plan.heartbeat_ms, 2, " ms")


def script_of(plan: DriveSetup, found: FoundDrive) -> Callable[[], Script]:
    """Return what makes the commissioning script of a drive."""

    def script() -> Script:
        found.proof = None
        found.is_mapped = False
        if problem := (yield from _prepare(plan, found)):
            return problem
        stops: list[Setting] = []
        for index, name in _stop_options(plan.device):
            option = yield from _prefer(index, name)
            if isinstance(option, Fault):
                return option
            stops.append(option)
        silence = _silence(plan)
        kept = yield from configure_and_start(
            *([] if (heartbeat := heartbeat_of(plan)) is None else [heartbeat]),
            *silence,
            *stops,
            *_motion(plan),
            *plan.device.dialect.settings,
        )
        if isinstance(kept, Fault):
            return kept
        for offset in plan.device.offsets[: 1 if plan.device.dialect.layout else None]:
            if problem := (yield from _runs_in_mode(0x6061 + offset, plan.device.mode)):
                return problem
        found.proof = _proof(plan, [*silence, *(s for s in stops if s.index & 0xFF == 0x5E)])
        return kept

    return script


def _prepare(plan: DriveSetup, found: FoundDrive) -> Check:
    """Keep the drive without power, see what it is, and map its PDOs."""
    if (heartbeat := heartbeat_of(plan)) and (problem := (yield from write(heartbeat))):
        return problem
    if problem := (yield from _identify(plan)):
        return problem
    for offset in plan.device.offsets[: 1 if plan.device.dialect.layout else None]:
        off = Request(0x6040 + offset, 0, "control word", 0, 2)
        response = yield off
        if response.value is None:
            return failure(off, response)
    if problem := (yield from _read_rated(plan, found)):
        return problem
    directions = (
        (0x1400, 0x1600, plan.layout.receive, RPDO_BASES, "RPDO"),
        (0x1800, 0x1A00, plan.layout.transmit, TPDO_BASES, "TPDO"),
    )
    for communication, mapping, pdos, bases, word in directions:
        by_number = {pdo.number: pdo for pdo in pdos}
        for place, base in enumerate(bases):
            problem = yield from _map(
                plan, communication + place, mapping + place, by_number.get(place + 1),
                base + plan.node_id, f"{word}{place + 1}",
            )  # fmt: skip
            if problem:
                return problem
    found.is_mapped = True
    return None


def _identify(plan: DriveSetup) -> Check:
    """Check that it is a drive of CiA 402, and the one that its EDS describes."""
    request = Request(0x1000, 0, "device type")
    response = yield request
    if response.value is None:
        return failure(request, response)
    if response.value & 0xFFFF != PROFILE:
        text = f"is another device: profile {response.value & 0xFFFF} instead of {PROFILE}"
        return Fault(FaultCode.NODE_OTHER_DEVICE, text)
    eds = plan.device.eds
    if eds is None:
        return None
    for subindex, name, wanted in ((1, "vendor", eds.vendor), (2, "product code", eds.product)):
        if wanted and (
            problem := (
                yield from expect(
                    Request(0x1018, subindex, name),
                    wanted,
                    name + " 0x{found:08X} is not that of its EDS, 0x{wanted:08X}",
                    FaultCode.NODE_OTHER_DEVICE,
                )
            )
        ):
            return problem
    return None


def _read_rated(plan: DriveSetup, found: FoundDrive) -> Check:
    """Read the current in whose per mille the drive tells its current."""
    found.rated_a = [plan.device.dialect.current_a * 1000.0] * len(plan.device.offsets)
    if plan.device.dialect.current_a:
        return None
    for axis, offset in enumerate(plan.device.offsets):
        if any((Role.CURRENT, axis) in pdo.parts for pdo in plan.layout.transmit):
            request = Request(0x6075 + offset, 0, "rated current")
            response = yield request
            if response.value is None and response.abort != ABORT_NO_OBJECT:
                return failure(request, response)
            found.rated_a[axis] = (response.value or 0) / 1000.0
    return None


def _map(
    plan: DriveSetup, communication: int, mapping: int, pdo: Pdo | None, identifier: int, name: str
) -> Check:
    """Configure one PDO, or switch it off; it is off while its mapping changes (CiA 301, 7.5.2)."""
    request = Request(communication, 1, f"identifier of {name}")
    response = yield request
    if response.value is None:
        is_absent = response.abort is not None and pdo is None
        return None if is_absent else failure(request, response)
    keeps_rtr = response.value & _NO_RTR
    off = Request(communication, 1, request.name, response.value | _INVALID, 4)
    response = yield off
    if response.value is None:
        return failure(off, response)
    if pdo is None:
        return None
    for setting in _pdo_settings(plan, communication, mapping, pdo, name):
        if problem := (yield from write(setting)):
            return problem
    on = Setting(communication, 1, request.name, keeps_rtr | identifier, 4, "")
    return (yield from write(on))


def _pdo_settings(
    plan: DriveSetup, communication: int, mapping: int, pdo: Pdo, name: str
) -> Iterator[Setting]:
    """Yield what is written while a PDO is off."""
    sends = communication >= 0x1800
    by_timer = sends and not pdo.every
    kind = pdo.every if sends and pdo.every else _BY_EVENT
    yield Setting(communication, 2, f"transmission type of {name}", kind, 1, "")
    if by_timer:
        ticks = round(plan.period_us * plan.device.dialect.event_per_ms / 1000)
        yield Setting(communication, 5, f"event timer of {name}", max(1, ticks), 2, "")
    if not plan.layout.is_ours:
        return
    yield Setting(mapping, 0, f"number of objects in {name}", 0, 1, "")
    for subindex, each in enumerate(pdo.objects, start=1):
        yield Setting(mapping, subindex, f"mapping of {name}", each.entry, 4, "")
    yield Setting(mapping, 0, f"number of objects in {name}", len(pdo.objects), 1, "")


def _stop_options(device: Device) -> Iterator[tuple[int, str]]:
    """Yield the objects that say how the drive brakes."""
    for offset in device.offsets:
        if device.can_write(0x605A + offset):
            yield 0x605A + offset, "quick stop option"
        if device.can_write(0x605E + offset):
            yield 0x605E + offset, "fault reaction option"


def _prefer(index: int, name: str) -> _Preferred:
    """Give an object the first of the options that brake which the drive takes."""
    problem = Fault(FaultCode.NONE, "")
    for option in BRAKING:
        setting = Setting(index, 0, name, option, 2, "")
        refused = yield from write(setting)
        if refused is None:
            return setting
        problem = refused
        if problem.code is FaultCode.NODE_NO_ANSWER:
            break
    return problem


def _silence(plan: DriveSetup) -> tuple[Setting, ...]:
    """Return the settings by which the drive notices a silent host, and what it does then."""
    device = plan.device
    settings: list[Setting] = []
    match device.silence:
        case Silence.OFF_LINE_TIME:
            index = device.dialect.off_line_ms
            settings.append(Setting(index, 0, "off-line time", plan.timeout_ms, 2, " ms"))
        case Silence.HEARTBEAT:
            consumer = plan.host_id << 16 | plan.timeout_ms
            settings.append(Setting(0x1016, 1, "heartbeat consumer", consumer, 4, ""))
        case Silence.GUARDING:
            guard_ms = plan.timeout_ms // GUARD_FACTOR
            settings.append(Setting(0x100C, 0, "guard time", guard_ms, 2, " ms"))
            settings.append(Setting(0x100D, 0, "life time factor", GUARD_FACTOR, 1, ""))
        case Silence.NONE:
            return ()
    if device.can_write(0x6007):
        settings.append(Setting(0x6007, 0, "abort connection option", _FAULT_SIGNAL, 2, ""))
    if device.can_write(0x1029, 1):
        # A drive that faults stays operational, so that it can say why it stopped.
        reaction = _STAY if device.can_write(0x6007) else _STOP_NODE
        settings.append(Setting(0x1029, 1, "communication error behaviour", reaction, 1, ""))
    return tuple(settings)


def _motion(plan: DriveSetup) -> Iterator[Setting]:
    """Yield the mode and the ramps."""
    device = plan.device
    packed = device.dialect.layout is not None
    for axis, (offset, fastest) in enumerate(zip(device.offsets, plan.fastest, strict=True)):
        if not packed or axis == 0:
            yield Setting(0x6060 + (0 if packed else offset), 0, "mode", device.mode, 1, "")
        if device.dialect.ramp is Ramp.TIME_MS:
            for index, name in ((0x6083, "acceleration time"), (0x6084, "deceleration time")):
                yield Setting(index, axis + 1, name, round(RAMP_S * 1000.0), 4, " ms")
            yield Setting(0x6085, axis + 1, "quick stop time", None, 4, " ms")
        elif device.dialect.ramp is Ramp.RATE:
            yield from _rates(device, offset, fastest)


def _rates(device: Device, offset: int, fastest: float) -> Iterator[Setting]:
    """Yield the ramps of an axis that are rates of velocity units per second."""
    ramp, stop = math.ceil(fastest / RAMP_S), math.ceil(fastest / STOP_S)
    if device.mode == PROFILE_VELOCITY:
        for index, name, rate in (
            (0x6083, "acceleration", ramp),
            (0x6084, "deceleration", ramp),
            (0x6085, "quick stop deceleration", stop),
        ):
            if device.can_write(index + offset):
                yield Setting(index + offset, 0, name, rate, 4, "")
    elif device.mode == VELOCITY:
        for index, name, rate in (
            (0x6048, "acceleration", ramp),
            (0x6049, "deceleration", ramp),
            (0x604A, "quick stop deceleration", stop),
        ):
            if device.can_write(index + offset, 1):
                yield Setting(index + offset, 1, f"{name}, speed", rate, 4, "")
                yield Setting(index + offset, 2, f"{name}, time", 1, 2, " s")


def _runs_in_mode(index: int, mode: int) -> Check:
    """Check that the drive shows the wanted mode; it may take a while to."""
    request = Request(index, 0, "mode display")
    response = SdoResponse()
    for _ in range(_MODE_READINGS):
        response = yield request
        if response.value in (None, mode):
            break
    if response.value is None:
        return failure(request, response)
    if response.value == mode:
        return None
    text = f"stays in mode {response.value}, wanted {mode}"
    return Fault(FaultCode.NODE_OTHER_VALUE, text)


def _proof(plan: DriveSetup, settings: list[Setting]) -> str:
    """Say by which settings the drive stops when the host is silent."""
    if not settings:
        return f"node {plan.node_id} has {Silence.NONE.value}; its maker's tool decides"
    return ", ".join(
        f"{each.index:04X}h:{each.subindex} = {plan.timeout_ms} ms of node {plan.host_id}"
        if each.index == 0x1016
        else f"{each.index:04X}h:{each.subindex} = {each.wanted}{each.unit}"
        for each in settings
    )
