"""Functions of robot and arguments that begin the faults of the catalogue.

Each returns what ends the fault, or None if it ends by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeAlias

from firmware_sim.bus.bits import INTERMISSION_BITS, frame_bits
from firmware_sim.bus.errors import PASSIVE_LIMIT, BusError
from firmware_sim.bus.faults import AckLess, Babble, Delay, Destroy, Drop, FrameFault
from firmware_sim.bus.faults import Fault as BusFault
from firmware_sim.errors import SimulationError
from firmware_sim.faults import fits
from firmware_sim.faults.faulty_parts import STUCK, FaultyAxis
from firmware_sim.faults.faulty_robot import MILLISECOND_NS, FaultyRobot
from firmware_sim.faults.parameters import Arguments, Undo
from firmware_sim.nodes import drive_objects, standard_objects, wire

Begin: TypeAlias = Callable[[FaultyRobot, Arguments], Undo | None]

OVERLOAD_IDS: Final = {"low": 0x7FF, "high": 0x002}
"""Ids of the unknown node of `overload`: below all others, or above all but emergency stop."""

PLACES_TRIED: Final = 1000

TEC_LOW, TEC_HIGH = PASSIVE_LIMIT + 8, PASSIVE_LIMIT + 40
"""Range in which a transmit error counter is held for error-passive; bus-off begins at 256."""

MAJOR_REVISION: Final = 0x0001_0000
OTHER_WIRE_VERSION: Final = wire.PROTOCOL_VERSION ^ 0xFFFF_FFFF


def number(arguments: Arguments, key: str) -> float:
    """Return an argument that is a number."""
    return float(arguments[key])


def _axis(robot: FaultyRobot, arguments: Arguments, key: str = "wheel") -> FaultyAxis:
    return robot.stage.axes[fits.wheels(robot.config)[str(arguments[key])]]


def _all(*ends: Undo) -> Undo:
    def end() -> None:
        for each in ends:
            each()

    return end


# Drive and sonars -------------------------------------------------------------------------------


def encoder(factor: int) -> Begin:
    """Return a fault that scales an encoder's counts."""
    return lambda robot, arguments: _axis(robot, arguments).own_encoder.begin(factor).end


def disconnect_encoder(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Open the inputs of an encoder, which then counts the bridge's noise: a random walk."""
    encoder, rate_hz = _axis(robot, arguments).own_encoder, number(arguments, "edges")
    fault = encoder.begin(STUCK)
    heard_ns = robot.bus.now_ns

    def pick_up() -> None:
        nonlocal heard_ns
        elapsed_s, heard_ns = (robot.bus.now_ns - heard_ns) * 1e-9, robot.bus.now_ns
        if fault.counts and robot.plant.powered:
            count = int(robot.rng.poisson(rate_hz * elapsed_s))
            encoder.jump(robot.turns(2 * int(robot.rng.binomial(count, 0.5)) - count))

    return _all(robot.repeat(pick_up), fault.end)


def glitch(robot: FaultyRobot, arguments: Arguments) -> None:
    """Make an encoder's count jump."""
    _axis(robot, arguments).own_encoder.jump(robot.turns(number(arguments, "counts")))


def swap(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Plug the encoders of two wheels into each other's sockets."""
    one, other = (_axis(robot, arguments, key).own_encoder.wheel for key in ("wheel", "other"))
    return robot.stage.swap(one, other)


def freeze(robot: FaultyRobot, _: Arguments) -> Undo:
    """Freeze all encoders."""
    return _all(*(axis.own_encoder.freeze().end for axis in robot.stage.axes))


def block(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Block a wheel."""
    return _axis(robot, arguments).block()


def slip(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Reduce the grip of a tyre to a share."""
    return _axis(robot, arguments).loosen(number(arguments, "grip"))


def draw_current(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Increase the current of a motor."""
    return _axis(robot, arguments).add_current(number(arguments, "amperes"))


def heat(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Heat a winding."""
    return _axis(robot, arguments).add_heat(number(arguments, "kelvin"))


def trip(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Raise a fault of a bought drive."""
    twin = robot.twin(str(arguments["drive"]))
    twin.trip(int(number(arguments, "code")))
    return twin.heal


def under_voltage(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Lower the drive's supply at once."""
    lost_v = number(arguments, "volts")

    def lose(volts: float) -> None:
        robot.stage.lose_voltage(volts)
        robot.supervise()

    lose(lost_v)
    return _all(robot.repeat(robot.supervise), lambda: lose(-lost_v))


def brown_out(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Let the drive's supply sag linearly to a voltage; the lowest of several counts."""
    stage, cause = robot.stage, object()
    left_v, supply_v = number(arguments, "volts"), robot.plant.bus_voltage_v
    if supply_v <= left_v:
        raise SimulationError(f"the supply has {supply_v:.2f} V, not over {left_v:g} V")
    start_ns, start_v = robot.bus.now_ns, max(stage.bus_voltage_v, left_v)

    def hold(ceiling_v: float | None) -> None:
        stage.hold_voltage(cause, ceiling_v)
        robot.supervise()

    def sag() -> None:
        elapsed_s = (robot.bus.now_ns - start_ns) * 1e-9
        share = min(elapsed_s / number(arguments, "sag"), 1.0)
        hold(start_v + share * (left_v - start_v))

    return _all(robot.repeat(sag), lambda: hold(None))


def carry(robot: FaultyRobot, _: Arguments) -> None:
    """Put the robot down at another place of the room."""
    low_x, low_y, high_x, high_y = robot.world.bounds
    for _attempt in range(PLACES_TRIED):
        x_m, y_m = robot.rng.uniform((low_x, low_y), (high_x, high_y))
        if not robot.world.is_known(x_m, y_m):
            continue
        before_rad = robot.plant.theta_rad
        try:
            robot.plant.place(x_m, y_m, robot.rng.uniform(-math.pi, math.pi))
        except SimulationError:
            continue
        turn_rad = math.remainder(robot.plant.theta_rad - before_rad, math.tau)
        robot.imu.carry(turn_rad, robot.bus.now_ns)
        return
    raise SimulationError(f"no place to put the robot down was found in {robot.world.name}")


def change_body(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Put the body in another state, such as with a load."""
    plant, before = robot.plant, robot.plant.body_state
    plant.use_body(robot.config.body.states.index(str(arguments["state"])))
    return lambda: plant.use_body(before)


def leak(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Make one sonar receive another's echo."""
    return robot.ring.leak(int(number(arguments, "sonar")), int(number(arguments, "other")))


def bias_gyro(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Add a bias to the gyro."""
    return robot.imu.add_bias(number(arguments, "rate"))


def tilt(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Tilt the robot."""
    roll_rad, pitch_rad = (math.radians(number(arguments, key)) for key in ("roll", "pitch"))
    within_ns = round(number(arguments, "within") * 1e9)
    tilting = robot.imu.tilt(roll_rad, pitch_rad, within_ns, robot.bus.now_ns)
    return lambda: tilting.end(robot.bus.now_ns)


# Nodes ------------------------------------------------------------------------------------------


def reset(robot: FaultyRobot, arguments: Arguments) -> None:
    """Power-cycle a node."""
    robot.power_cycle(str(arguments["node"]))


def lose_parameters(robot: FaultyRobot, arguments: Arguments) -> None:
    """Damage a node's stored parameters, and reboot it."""
    name = str(arguments["node"])
    robot.stores[name].damaged = True
    robot.power_cycle(name)


def change_parameter(robot: FaultyRobot, arguments: Arguments) -> None:
    """Change a parameter in a node's memory, even one that its firmware refuses."""
    name, index, sub_index = fits.PARAMETERS[str(arguments["parameter"])]
    node = robot.node(name)
    size = node.dictionary.variable(index, sub_index).size or 0
    value = int(number(arguments, "value")) % 256**size
    node.dictionary.force(index, sub_index, value)


def flash(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Boot a node with other firmware, and with its own when the fault ends.

    Each such fault raises the major revision by one; its own is back when all are over.
    """
    node = robot.node(str(arguments["node"]))

    def boot(raised: int) -> None:
        revision = int.from_bytes(node.dictionary.upload(standard_objects.IDENTITY, 3), "little")
        revision += raised
        is_own = revision == standard_objects.REVISION
        wire_version = wire.PROTOCOL_VERSION if is_own else OTHER_WIRE_VERSION
        node.dictionary.on_read(standard_objects.IDENTITY, 3, lambda: revision)
        if node.name == "drive":
            node.dictionary.on_read(drive_objects.PROTOCOL_VERSION, 0, lambda: wire_version)
        robot.power_cycle(node.name)

    boot(MAJOR_REVISION)
    return lambda: boot(-MAJOR_REVISION)


def drift(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Detune a node's oscillator."""
    node, ppm = robot.node(str(arguments["node"])), number(arguments, "ppm")
    node.clock.drift(ppm, robot.bus.now_ns)
    return lambda: node.clock.drift(-ppm, robot.bus.now_ns)


# Bus --------------------------------------------------------------------------------------------


def lose(*identifiers: int) -> Begin:
    """Return a fault in which receivers lose all frames of some identifiers."""

    def begin(robot: FaultyRobot, arguments: Arguments) -> None:
        for identifier in identifiers:
            robot.on_bus(Drop, arguments, arbitration_id=identifier)

    return begin


def on_bus(make: Callable[..., BusFault]) -> Begin:
    """Return a function that injects a fault of the whole bus."""
    return lambda robot, arguments: robot.on_bus(make, arguments)


def on_node(make: Callable[..., BusFault], **more: object) -> Begin:
    """Return a function that injects a fault of one node of the robot."""
    return lambda robot, arguments: robot.on_bus(make, arguments, node=arguments["node"], **more)


def on_host(make: Callable[..., BusFault], **more: object) -> Begin:
    """Return a function that injects a fault of the host's controller."""
    return lambda robot, arguments: robot.on_bus(make, arguments, node=robot.host(), **more)


def _hold_passive(robot: FaultyRobot, name: str) -> Undo:
    """Destroy enough frames of a node to hold its transmit error counter in error-passive."""
    bus = robot.bus_of(name)

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

    return robot.repeat(push)


def node_passive(robot: FaultyRobot, arguments: Arguments) -> Undo:
    """Hold a node error-passive."""
    return _hold_passive(robot, str(arguments["node"]))


def host_passive(robot: FaultyRobot, _: Arguments) -> Undo:
    """Hold the host error-passive."""
    return _hold_passive(robot, robot.host())


def overload(robot: FaultyRobot, arguments: Arguments) -> None:
    """Let an unknown device fill a share of the drive's bus."""
    bus = robot.bus_of("drive")
    identifier, data = OVERLOAD_IDS[str(arguments["priority"])], bytes(8)
    bits = frame_bits(identifier, data) + INTERMISSION_BITS
    share = number(arguments, "load")
    period_ns = 0 if share >= 1.0 else round(bits * bus.bit_ns / share)
    name = f"stranger{len(bus.ports)}@{bus.now_ns}"
    port = bus.attach(name, lambda _: None, accept=())
    robot.on_bus(AckLess, arguments, node=name)
    robot.on_bus(
        Babble, arguments, node=name, arbitration_id=identifier, data=data, period_ns=period_ns
    )
    bus.schedule(robot.end_ns(arguments), port.detach)


# Frames -----------------------------------------------------------------------------------------


def on_frames(make: Callable[..., FrameFault], **more: object) -> Begin:
    """Return a function that injects a fault of frames."""
    return lambda robot, arguments: robot.on_frames(make, arguments, **more)


def delay(robot: FaultyRobot, arguments: Arguments) -> None:
    """Delay frames."""
    robot.on_frames(Delay, arguments, delay_ns=round(number(arguments, "delay") * 1e9))


def masquerade(robot: FaultyRobot, arguments: Arguments) -> None:
    """Let the sonar node send motor commands."""
    robot.on_bus(
        Babble, arguments, node="sonar", arbitration_id=wire.MOTOR_COMMAND,
        data=bytes.fromhex("0010E803E8030000"), period_ns=5_000_000,
    )  # fmt: skip
