"""One control tick of each kind of bought drive beside a peer from that drive's own package.

A tick is all that the drives of a robot do in it: take the frames that have come, judge them,
report, and command. The robot drives in the simulator; each tick's frames go to robotctl's drives
and to the peer, in turn first, and each has its time taken alone. The peer decodes the same frames
and encodes a command by its package; it judges and checks nothing, which favours it.

pyvesc knows VESC's serial port only: its tick is one request and answer of the values, a speed, and
a position in the place of the servo's, which it does not know. It is no dependency of ours, as the
package that it wants for its checksum cannot be installed: `_crc_of_pyvesc` stands in for that.
`uv pip install --python .venv/bin/python --no-deps pyvesc==1.0.5` installs it by hand.
"""

from __future__ import annotations

import binascii
import importlib
import math
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from types import ModuleType, SimpleNamespace
from typing import Any, Protocol

from benchmarks import machine
from robotctl.app.processes.robot import make_codec, make_parts
from robotctl.app.simulation.lockstep_stack import attach_port, make_simulation
from robotctl.config.robot_file import config_directory, find_file, load_robot
from robotctl.drivers.can.drives.motor_drive import MotorConfig
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.ports import Frame
from robotctl.runtime.clock import VirtualClock

GOAL = 0.5
"""Greatest share of the peer's time."""

TICKS = 400
"""In each round."""

SPEED_RAD_S = 3.0
_COMMISSIONING_TICKS = 4000
_SYNC = 0x080
_SETTINGS = 0x05
"""ODrive's TxSdo, by which robotctl reads the settings again; the peer does not."""


class Peer(Protocol):
    """A control tick by a drive's own package."""

    def __call__(self, frames: Sequence[Frame]) -> None:
        """Take the frames of a tick and command all axes."""


class Driven:
    """A simulated robot whose drives are in service and turn its wheels.

    Parameters
    ----------
    robot
        Name of the robot's file, with one bus.
    """

    def __init__(self, robot: str) -> None:
        file = find_file(robot)
        self.config = config = load_robot(file)
        self.simulation = make_simulation(file, find_file("hall", "worlds"), 1, (6.0, 6.0, 0.0))
        self._clock = VirtualClock(self.simulation.now_ns)
        parts = make_parts(config, make_codec())
        (bus,) = config.buses
        identifiers = parts.identifiers(bus.name)
        self._port = attach_port(self.simulation.bus, bus, identifiers, self._clock)
        self._drives = [each.drive for each in parts.drives]
        self._handlers = {
            key: each for drive in self._drives for key, each in drive.handlers.items()
        }
        self._sent: list[tuple[int, bytes]] = []
        self._commands = [ActuatorCommand(enable=False, brake=True)] * len(self._drives)
        for _ in range(_COMMISSIONING_TICKS):
            self._pass_tick()
            if not any(drive.status.problem for drive in self._drives):
                break
        self._commands = [_forward(each) for each in config.motors]
        for _ in range(100):
            self._pass_tick()

    def tick(self) -> tuple[list[Frame], int]:
        """Let a period pass; return the drives' frames, and the time [ns]."""
        now_ns = self._clock.now_ns() + self.config.runtime.period_ns
        self.simulation.advance(now_ns)
        self._clock.sleep_until(now_ns)
        frames = self._port.receive()
        return [each for each in frames if each.arbitration_id in self._handlers], now_ns

    def work(self, frames: list[Frame], now_ns: int) -> None:
        """Do what robotctl's drives do in a tick."""
        handlers = self._handlers
        for arbitration_id, data, stamp_ns in frames:
            handlers[arbitration_id](data, stamp_ns)
        for drive, command in zip(self._drives, self._commands, strict=True):
            drive.check(now_ns)
            drive.command(self._put, command, now_ns)

    def _put(self, arbitration_id: int, data: bytes) -> bool:
        self._sent.append((arbitration_id, data))
        return True

    def flush(self, now_ns: int) -> None:
        """Put the commands on the bus, and what else the drives send."""
        for frame in self._sent:
            self._port.send(*frame)
        self._sent.clear()
        if any(drive.wants_sync for drive in self._drives):
            self._port.send(_SYNC, b"")
        for drive in self._drives:
            drive.serve(self._port.send, now_ns)

    def _pass_tick(self) -> None:
        frames, now_ns = self.tick()
        self.work(frames, now_ns)
        self.flush(now_ns)


def _forward(motor: MotorConfig) -> ActuatorCommand:
    """Return the command that turns all wheels of a drive forward, joints straight."""
    names = (axis.actuator for axis in motor.axes)
    values = (0.0 if name == "steering" else SPEED_RAD_S for name in names)
    return ActuatorCommand(enable=True, brake=True, values=tuple(values))


def _odrive(driven: Driven) -> Peer:
    """Return the tick of odrive-can 2.1: its messages by its DBC."""
    can, package = importlib.import_module("can"), importlib.import_module("odrive_can.odrive")
    bus = SimpleNamespace(send=lambda _: None, shutdown=lambda: None)
    axes = [
        package.ODriveCAN(number, bus)
        for motor in driven.config.motors
        for number in motor.node_ids
    ]

    def tick(frames: Sequence[Frame]) -> None:
        for arbitration_id, data, _ in frames:
            if arbitration_id & 0x1F == _SETTINGS:
                continue
            message = can.Message(arbitration_id=arbitration_id, is_extended_id=False, data=data)
            package.CanMsg(message)
        for axis in axes:
            axis._send_message("Set_Input_Vel", {"Input_Vel": 0.5})

    return tick


def _canopen(driven: Driven) -> Peer:
    """Return the tick of canopen 2.4: its PDOs, mapped as robotctl has mapped them."""
    canopen = importlib.import_module("canopen")
    network = canopen.Network()
    network.bus = SimpleNamespace(send=lambda _: None, channel_info="none")
    (twin,) = driven.simulation.twins
    eds = config_directory() / "drives" / "cia402.eds"
    node = network.add_node(twin.node_id, str(eds))
    received = {pdo.cob_id: pdo for pdo in _mapped(node.tpdo, twin.dictionary, 0x1800)}
    sent = _mapped(node.rpdo, twin.dictionary, 0x1400)

    def tick(frames: Sequence[Frame]) -> None:
        for arbitration_id, data, stamp_ns in frames:
            pdo = received.get(arbitration_id)
            if pdo is not None:
                pdo.on_message(arbitration_id, bytearray(data), stamp_ns * 1e-9)
                for variable in pdo:
                    variable.raw  # noqa: B018 - this decodes it
        for pdo in sent:
            for variable, value in zip(pdo, (15, 1000), strict=False):
                variable.raw = value
            pdo.transmit()

    return tick


def _mapped(maps: Any, dictionary: Any, communication: int) -> list[Any]:
    """Return the PDOs of the package that a drive has switched on, mapped as the drive has them."""
    found = []
    for number, pdo in maps.items():
        parameter = communication + number - 1
        mapping = parameter + 0x200
        identifier = dictionary.number(parameter, 1)
        count = dictionary.number(mapping, 0)
        if identifier >> 31 or not count:
            continue
        pdo.clear()
        for sub in range(1, count + 1):
            entry = dictionary.number(mapping, sub)
            pdo.add_variable(entry >> 16, entry >> 8 & 0xFF, entry & 0xFF)
        pdo.cob_id, pdo.enabled = identifier & 0x7FF, True
        found.append(pdo)
    return found


def _moteus(driven: Driven) -> Peer:
    """Return the tick of moteus 1.1.1: its commands and the parser of its answers."""
    moteus = importlib.import_module("moteus")
    protocol = importlib.import_module("moteus.protocol")
    query = moteus.QueryResolution()
    query.voltage = query.temperature = query.fault = moteus.INT16
    drives = [
        moteus.Controller(number, query_resolution=query, transport=object())
        for number in range(1, len(driven.config.motors) + 1)
    ]

    def tick(frames: Sequence[Frame]) -> None:
        for _, data, _ in frames:
            protocol.parse_reply(data)
        for drive in drives:
            drive.make_position(position=math.nan, velocity=0.5, watchdog_timeout=0.09, query=True)

    return tick


def _vesc(_: Driven) -> Peer:
    """Return the tick of pyvesc 1.0.5: values asked for and decoded, speed and position set."""
    sys.modules.setdefault("PyCRC", ModuleType("PyCRC"))
    sys.modules.setdefault("PyCRC.CRCCCITT", _crc_of_pyvesc())
    pyvesc = importlib.import_module("pyvesc")
    codec = importlib.import_module("pyvesc.packet.codec")
    payload = bytes((4, *range(55)))
    answer = codec.frame(payload)
    if pyvesc.decode(answer)[1] != len(answer):
        raise ImportError("pyvesc does not decode its own packet")

    def tick(_: Sequence[Frame]) -> None:
        pyvesc.decode(answer)
        pyvesc.encode_request(pyvesc.GetValues)
        pyvesc.encode(pyvesc.SetRPM(1000))
        pyvesc.encode(pyvesc.SetPosition(90.0))

    return tick


def _crc_of_pyvesc() -> ModuleType:
    """Return a stand-in for `PyCRC.CRCCCITT`: CRC-CCITT from 0, in C."""
    module = ModuleType("PyCRC.CRCCCITT")

    class CRCCCITT:
        def calculate(self, data: bytes) -> int:
            return binascii.crc_hqx(bytes(data), 0)

    module.CRCCCITT = CRCCCITT  # type: ignore[attr-defined]
    return module


PEERS: dict[str, tuple[str, str, Callable[[Driven], Peer]]] = {
    "skid_steer": ("ODrive, 4 axes", "odrive-can", _odrive),
    "cia402": ("CiA 402, 2 axes", "canopen", _canopen),
    "moteus": ("moteus, 2 drives", "moteus", _moteus),
    "vesc_car": ("VESC and servo", "pyvesc", _vesc),
}
"""By robot: what drives it, the package, and its tick."""


def run(rounds: int, _seconds: float) -> None:
    """Measure each kind of drive and its peer on the same ticks."""
    rows = []
    for robot, (kind, package, make) in PEERS.items():
        driven = Driven(robot)
        try:
            peer = make(driven)
        except ImportError as error:
            machine.note(f"{package}: not run: {error}")
            continue
        found = [_round(driven, peer) for _ in range(rounds)]
        ours, theirs = ([each[side] for each in found] for side in (0, 1))
        ratios = [our / their for our, their in found]
        verdict = "yes" if statistics.median(ratios) <= GOAL else "no"
        rows.append(
            (
                kind,
                machine.spread(ours, 1),
                package,
                machine.spread(theirs, 1),
                machine.spread(ratios, 2),
                verdict,
            )
        )
    heads = ("drives", "robotctl us", "peer", "peer us", "ratio", f"at most {GOAL:g}")
    machine.table("A control tick of bought drives", heads, rows)


def _round(driven: Driven, peer: Peer) -> tuple[float, float]:
    """Return the medians of a tick of ours and of the peer's [us]."""
    ours_ns, theirs_ns = [], []
    clock = time.perf_counter_ns
    for number in range(TICKS):
        frames, now_ns = driven.tick()
        for side in (0, 1) if number % 2 else (1, 0):
            begin_ns = clock()
            if side:
                peer(frames)
                theirs_ns.append(clock() - begin_ns)
            else:
                driven.work(frames, now_ns)
                ours_ns.append(clock() - begin_ns)
        driven.flush(now_ns)
    return statistics.median(ours_ns) / 1e3, statistics.median(theirs_ns) / 1e3
