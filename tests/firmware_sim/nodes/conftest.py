"""A line on which simulated nodes can be tested without a bus, and a host that speaks to them.

The host's frames are made by cantools and the autosar-e2e package: nothing of firmware_sim.
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import cantools
import pytest
from e2e import p01

from firmware_sim.nodes.drive import ENABLE_FRAMES, DriveNode
from firmware_sim.nodes.drive_guards import MotorModel
from firmware_sim.plant.axis import Mode

ROOT = Path(__file__).parents[3]
MS = 1_000_000


class LineFrame(NamedTuple):
    arbitration_id: int
    data: bytes
    stamp_ns: int


class Line:
    """Delivers frames without delay and wakes nodes at the time they asked for."""

    def __init__(self):
        self.now_ns = 0
        self.nodes = []
        self.sent = []
        self._alarms = []
        self._order = itertools.count()

    def add(self, node):
        node.connect(self, self._alarm)
        self.nodes.append(node)
        node.power_cycle(self.now_ns)
        return node

    def _alarm(self, due_ns, node):
        heapq.heappush(self._alarms, (due_ns, next(self._order), node))

    def send(self, arbitration_id, data):
        self.sent.append(LineFrame(arbitration_id, bytes(data), self.now_ns))
        return True

    def deliver(self, arbitration_id, data=b""):
        for node in self.nodes:
            node.on_frame(LineFrame(arbitration_id, bytes(data), self.now_ns))

    def run_to(self, until_ns):
        while self._alarms and self._alarms[0][0] <= until_ns:
            due_ns, _, node = heapq.heappop(self._alarms)
            self.now_ns = max(self.now_ns, due_ns)
            node.wake(self.now_ns)
        self.now_ns = until_ns

    def run_ms(self, duration_ms):
        self.run_to(self.now_ns + round(duration_ms * MS))

    def frames(self, arbitration_id):
        return [frame for frame in self.sent if frame.arbitration_id == arbitration_id]

    def start_all(self):
        self.run_to(20 * MS)
        self.deliver(0x000, b"\x01\x00")


@dataclass
class Axis:
    """A motor that does what the test says, with an encoder of its own."""

    count: int = 0
    current_a: float = 0.0
    temperature_c: float = 25.0
    mode: Mode | None = None
    value: float = 0.0

    def command(self, mode, value=0.0):
        self.mode, self.value = mode, value

    def encoder(self, counts_per_revolution):
        assert counts_per_revolution == MODEL.counts_per_revolution
        return self


@dataclass
class Stage:
    """A power stage that does what the test says and remembers what it was told."""

    axes: tuple[Axis, Axis] = field(default_factory=lambda: (Axis(), Axis()))
    bus_voltage_v: float = 12.0
    steering_rad: float = 0.0
    steering_cmd_rad: float = 0.0
    commands: list = field(default_factory=list)

    def steer(self, angle_rad):
        self.steering_cmd_rad = angle_rad
        one, two = self.axes
        assert one.mode is two.mode
        self.commands.append((one.value, two.value, angle_rad, one.mode))


class Host:
    """Sends protected MotorCommand frames."""

    def __init__(self, line, database):
        self.line = line
        self.counter = 0
        self.message = database.get_message_by_name("MotorCommand")

    def frame(self, enable=True, duty1=0.0, duty2=0.0, steering=0.0, brake=False, counter=None):
        data = bytearray(
            self.message.encode(
                {
                    "Crc": 0,
                    "Counter": self.counter if counter is None else counter,
                    "Enable": int(enable),
                    "Brake": int(brake),
                    "Duty1": duty1,
                    "Duty2": duty2,
                    "SteeringAngle": steering,
                }
            )
        )
        return self.sealed(data)

    def sealed(self, data):
        p01.e2e_p01_protect(data, 0xA201, length=8, increment_counter=False)
        self.counter = ((data[1] & 0xF) + 1) % 15
        return bytes(data)

    def send(self, **fields):
        data = self.frame(**fields)
        self.line.deliver(0x201, data)
        return data

    def drive(self, ms, period_ms=5, **fields):
        """Send a command and a SYNC each period."""
        for _ in range(round(ms / period_ms)):
            self.send(**fields)
            self.line.deliver(0x080)
            self.line.run_ms(period_ms)


MODEL = MotorModel(
    resistance_ohm=1.2, back_emf_v_s_rad=0.45, current_limit_a=10.0, counts_per_revolution=2400
)


class DriveRig:
    """A drive with a fake power stage, in operational."""

    def __init__(self, database, store=None):
        self.line = Line()
        self.stage = Stage()
        self.drive = DriveNode(
            self.stage, self.stage.axes, lambda now_ns: now_ns // MS * MS, MODEL, store
        )
        self.line.add(self.drive)
        self.line.start_all()
        self.host = Host(self.line, database)
        self.database = database

    def sdo(self, request):
        before = len(self.line.sent)
        self.line.deliver(0x601, request)
        [answer] = [f.data for f in self.line.sent[before:] if f.arbitration_id == 0x581]
        return answer

    def write(self, index, sub_index, value, size):
        command = 0x23 | (4 - size) << 2
        head = bytes((command,)) + index.to_bytes(2, "little") + bytes((sub_index,))
        return self.sdo(head + value.to_bytes(4, "little"))

    def read(self, index, sub_index=0):
        answer = self.sdo(b"\x40" + index.to_bytes(2, "little") + bytes((sub_index,)) + bytes(4))
        assert answer[0] & 0xF3 == 0x43, answer.hex()
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little")

    def clear_faults(self):
        return self.write(0x2010, 0, 1, 1)

    def enable(self):
        self.host.send(enable=False)
        for _ in range(ENABLE_FRAMES):
            self.host.send(enable=True)
        assert self.drive.drive_state.name == "ENABLED"

    def last(self, name):
        message = self.database.get_message_by_name(name)
        return message.decode(self.line.frames(message.frame_id)[-1].data, decode_choices=False)


@pytest.fixture(scope="session")
def database():
    return cantools.database.load_file(ROOT / "configs" / "robot.dbc")


@pytest.fixture
def line():
    return Line()


@pytest.fixture
def rig(database):
    return DriveRig(database)


@pytest.fixture(scope="session")
def make_rig(database):
    return lambda store=None: DriveRig(database, store)
