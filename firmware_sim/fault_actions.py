"""How the faults of the catalogue begin: functions of `Faults` and the arguments.

Each returns what ends the fault, or None where it ends by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, TypeAlias

from firmware_sim.bus.bits import INTERMISSION_BITS, frame_bits
from firmware_sim.bus.errors import PASSIVE_LIMIT, BusError
from firmware_sim.bus.faults import AckLess, Babble, Delay, Destroy, Drop, FrameFault
from firmware_sim.bus.faults import Fault as BusFault
from firmware_sim.errors import SimulationError
from firmware_sim.fault_kinds import Arguments, Undo
from firmware_sim.faulty_parts import STUCK
from firmware_sim.nodes import drive_objects, standard_objects, wire
from firmware_sim.nodes.power import CRITICAL_LIMIT, LOW_LIMIT
from firmware_sim.nodes.sonar import RING_PERIOD

if TYPE_CHECKING:
    from firmware_sim.faults import Faults
    from firmware_sim.nodes.node import Node

Begin: TypeAlias = "Callable[[Faults, Arguments], Undo | None]"

WHEELS: Final = {"left": 0, "right": 1, "drive": 0}
OVERLOAD_IDS: Final = {"low": 0x7FF, "high": 0x002}
"""What the stranger of `overload` sends: behind everybody, or before all but emergency stop."""

MILLISECOND_NS: Final = 1_000_000

PARAMETERS: Final = {
    "command_timeout": ("drive", drive_objects.COMMAND_TIMEOUT, 0),
    "current_limit": ("drive", drive_objects.CURRENT_LIMIT, 0),
    "temperature_limit": ("drive", drive_objects.TEMPERATURE_LIMIT, 0),
    "voltage_limit": ("drive", drive_objects.VOLTAGE_LIMIT, 0),
    "motor_status_syncs": ("drive", drive_objects.MOTOR_STATUS_PDO, 2),
    "drive_status_syncs": ("drive", drive_objects.DRIVE_STATUS_PDO, 2),
    "drive_heartbeat": ("drive", standard_objects.HEARTBEAT_TIME, 0),
    "ring_period": ("sonar", RING_PERIOD, 0),
    "battery_low": ("power", LOW_LIMIT, 0),
    "battery_critical": ("power", CRITICAL_LIMIT, 0),
}
"""What the host relies on in the memory of nodes: node and object."""

PLACES_TRIED: Final = 1000

TEC_LOW, TEC_HIGH = PASSIVE_LIMIT + 8, PASSIVE_LIMIT + 40
"""Between these a transmit error counter is held for error-passive: bus-off begins at 256."""

MAJOR_REVISION: Final = 0x0001_0000
OTHER_WIRE_VERSION: Final = wire.PROTOCOL_VERSION ^ 0xFFFF_FFFF


def number(arguments: Arguments, key: str) -> float:
    """Return an argument that is a number."""
    return float(arguments[key])


def _channel(arguments: Arguments) -> int:
    return WHEELS[str(arguments["wheel"])]


def _node(faults: Faults, arguments: Arguments) -> Node:
    return next(each for each in faults.simulation.nodes if each.name == arguments["node"])


def _all(*ends: Undo) -> Undo:
    def end() -> None:
        for each in ends:
            each()

    return end


# Drive and sonars -------------------------------------------------------------------------------


def encoder(factor: int) -> Begin:
    """Return what lets an encoder count by a factor."""
    return lambda faults, arguments: faults.stage.break_encoder(_channel(arguments), factor).end


def disconnect_encoder(faults: Faults, arguments: Arguments) -> Undo:
    """Let an encoder count what its open inputs pick up of the switching bridge: a random walk."""
    channel, rate_hz = _channel(arguments), number(arguments, "edges")
    simulation, stage = faults.simulation, faults.stage
    fault = stage.break_encoder(channel, STUCK)
    heard_ns = simulation.now_ns

    def pick_up() -> None:
        nonlocal heard_ns
        elapsed_s, heard_ns = (simulation.now_ns - heard_ns) * 1e-9, simulation.now_ns
        if fault.counts and simulation.plant.powered:
            count = int(faults.rng.poisson(rate_hz * elapsed_s))
            stage.jump(channel, 2 * int(faults.rng.binomial(count, 0.5)) - count)

    return _all(faults.repeat(pick_up), fault.end)


def glitch(faults: Faults, arguments: Arguments) -> None:
    """Let an encoder's count jump."""
    faults.stage.jump(_channel(arguments), int(number(arguments, "counts")))


def freeze(faults: Faults, _: Arguments) -> Undo:
    """Let both encoders stand still."""
    return _all(*(faults.stage.break_encoder(channel, STUCK).end for channel in (0, 1)))


def block(faults: Faults, arguments: Arguments) -> Undo:
    """Hold a wheel."""
    return faults.stage.block(_channel(arguments))


def draw_current(faults: Faults, arguments: Arguments) -> Undo:
    """Let a motor draw more current."""
    return faults.stage.add_current(_channel(arguments), number(arguments, "amperes"))


def heat(faults: Faults, arguments: Arguments) -> Undo:
    """Let a winding be hotter."""
    return faults.stage.add_heat(_channel(arguments), number(arguments, "kelvin"))


def under_voltage(faults: Faults, arguments: Arguments) -> Undo:
    """Lower the drive's supply at once."""
    simulation, lost_v = faults.simulation, number(arguments, "volts")

    def lose(volts: float) -> None:
        faults.stage.lose_voltage(volts)
        simulation.supervise()

    lose(lost_v)
    return _all(faults.repeat(simulation.supervise), lambda: lose(-lost_v))


def brown_out(faults: Faults, arguments: Arguments) -> Undo:
    """Let the drive's supply sag evenly to what is left; of several the lowest counts."""
    simulation, stage, cause = faults.simulation, faults.stage, object()
    left_v, supply_v = number(arguments, "volts"), simulation.plant.bus_voltage_v
    if supply_v <= left_v:
        raise SimulationError(f"the supply has {supply_v:.2f} V, not over {left_v:g} V")
    start_ns, start_v = simulation.now_ns, max(stage.bus_voltage_v, left_v)

    def hold(ceiling_v: float | None) -> None:
        stage.hold_voltage(cause, ceiling_v)
        simulation.supervise()

    def sag() -> None:
        elapsed_s = (simulation.now_ns - start_ns) * 1e-9
        share = min(elapsed_s / number(arguments, "sag"), 1.0)
        hold(start_v + share * (left_v - start_v))

    return _all(faults.repeat(sag), lambda: hold(None))


def carry(faults: Faults, _: Arguments) -> None:
    """Put the robot down at another place of the room."""
    simulation = faults.simulation
    low_x, low_y, high_x, high_y = simulation.world.bounds
    for _attempt in range(PLACES_TRIED):
        x_m, y_m = faults.rng.uniform((low_x, low_y), (high_x, high_y))
        if not simulation.world.is_known(x_m, y_m):
            continue
        try:
            simulation.plant.place(x_m, y_m, faults.rng.uniform(-math.pi, math.pi))
        except SimulationError:
            continue
        return
    raise SimulationError(f"no place to put the robot down was found in {simulation.world.name}")


def leak(faults: Faults, arguments: Arguments) -> Undo:
    """Let one sonar hear another."""
    return faults.ring.leak(int(number(arguments, "sonar")), int(number(arguments, "other")))


# Nodes ------------------------------------------------------------------------------------------


def reset(faults: Faults, arguments: Arguments) -> None:
    """Power-cycle a node."""
    faults.simulation.power_cycle(str(arguments["node"]))


def lose_parameters(faults: Faults, arguments: Arguments) -> None:
    """Damage what a node has stored, and let it boot."""
    name = str(arguments["node"])
    faults.simulation.stores[name].damaged = True
    faults.simulation.power_cycle(name)


def change_parameter(faults: Faults, arguments: Arguments) -> None:
    """Change what a node has in its memory, whatever its firmware refuses."""
    name, index, sub_index = PARAMETERS[str(arguments["parameter"])]
    node = next(each for each in faults.simulation.nodes if each.name == name)
    size = node.dictionary.variable(index, sub_index).size or 0
    value = int(number(arguments, "value")) % 256**size
    node.dictionary.force(index, sub_index, value)


def flash(faults: Faults, arguments: Arguments) -> Undo:
    """Let a node boot with other firmware; in the end it boots with its own.

    Each such fault raises the major revision by one: its own is back when all of them are over.
    """
    node = _node(faults, arguments)

    def boot(raised: int) -> None:
        revision = int.from_bytes(node.dictionary.upload(standard_objects.IDENTITY, 3), "little")
        revision += raised
        is_own = revision == standard_objects.REVISION
        wire_version = wire.PROTOCOL_VERSION if is_own else OTHER_WIRE_VERSION
        node.dictionary.on_read(standard_objects.IDENTITY, 3, lambda: revision)
        if node is faults.simulation.drive:
            node.dictionary.on_read(drive_objects.PROTOCOL_VERSION, 0, lambda: wire_version)
        faults.simulation.power_cycle(node.name)

    boot(MAJOR_REVISION)
    return lambda: boot(-MAJOR_REVISION)


def drift(faults: Faults, arguments: Arguments) -> Undo:
    """Let a node's oscillator be off."""
    node, ppm = _node(faults, arguments), number(arguments, "ppm")
    node.clock.drift(ppm, faults.simulation.now_ns)
    return lambda: node.clock.drift(-ppm, faults.simulation.now_ns)


# Bus --------------------------------------------------------------------------------------------


def lose(*identifiers: int) -> Begin:
    """Return what lets receivers lose all frames of some identifiers."""

    def begin(faults: Faults, arguments: Arguments) -> None:
        for identifier in identifiers:
            faults.on_bus(Drop, arguments, arbitration_id=identifier)

    return begin


def on_bus(make: Callable[..., BusFault]) -> Begin:
    """Return what injects a fault of the whole bus."""
    return lambda faults, arguments: faults.on_bus(make, arguments)


def on_node(make: Callable[..., BusFault], **more: object) -> Begin:
    """Return what injects a fault of one node of the robot."""
    return lambda faults, arguments: faults.on_bus(make, arguments, node=arguments["node"], **more)


def on_host(make: Callable[..., BusFault], **more: object) -> Begin:
    """Return what injects a fault of the host's controller."""
    return lambda faults, arguments: faults.on_bus(make, arguments, node=faults.host(), **more)


def _hold_passive(faults: Faults, name: str) -> Undo:
    """Destroy as many frames of a node as hold its transmit error counter in error-passive."""
    bus = faults.simulation.bus

    def push() -> None:
        port = next((each for each in bus.ports if each.name == name), None)
        if port is not None and port.counters.tec < TEC_LOW:
            count = (TEC_HIGH - port.counters.tec) // 8
            bus.inject(
                Destroy(
                    node=name,
                    error=BusError.BIT_ERROR,
                    count=count,
                    start_ns=bus.now_ns,
                    end_ns=bus.now_ns + MILLISECOND_NS,
                )
            )

    return faults.repeat(push)


def node_passive(faults: Faults, arguments: Arguments) -> Undo:
    """Hold a node error-passive."""
    return _hold_passive(faults, str(arguments["node"]))


def host_passive(faults: Faults, _: Arguments) -> Undo:
    """Hold the host error-passive."""
    return _hold_passive(faults, faults.host())


def overload(faults: Faults, arguments: Arguments) -> None:
    """Let a device that does not belong there fill a share of the bus."""
    bus = faults.simulation.bus
    identifier, data = OVERLOAD_IDS[str(arguments["priority"])], bytes(8)
    bits = frame_bits(identifier, data) + INTERMISSION_BITS
    share = number(arguments, "load")
    period_ns = 0 if share >= 1.0 else round(bits * bus.bit_ns / share)
    name = f"stranger{len(bus.ports)}@{bus.now_ns}"
    port = bus.attach(name, lambda _: None, accept=())
    faults.on_bus(AckLess, arguments, node=name)
    faults.on_bus(
        Babble, arguments, node=name, arbitration_id=identifier, data=data, period_ns=period_ns
    )
    bus.schedule(faults.end_ns(arguments), port.detach)


# Frames -----------------------------------------------------------------------------------------


def on_frames(make: Callable[..., FrameFault], **more: object) -> Begin:
    """Return what injects a fault of frames."""
    return lambda faults, arguments: faults.on_frames(make, arguments, **more)


def delay(faults: Faults, arguments: Arguments) -> None:
    """Let frames be late."""
    faults.on_frames(Delay, arguments, delay_ns=round(number(arguments, "delay") * 1e9))


def masquerade(faults: Faults, arguments: Arguments) -> None:
    """Let the sonar node send motor commands."""
    faults.on_bus(
        Babble, arguments, node="sonar", arbitration_id=wire.MOTOR_COMMAND,
        data=bytes.fromhex("0010E803E8030000"), period_ns=5_000_000,
    )  # fmt: skip
