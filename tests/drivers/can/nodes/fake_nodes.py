"""A bus of three nodes that can lie, keep silent, forget and restart."""

import struct

from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.memory_port import MemoryPort
from robotctl.messages.actuators import ActuatorCommand
from tests.native_frames import DIFFERENTIAL, native_parts, native_robot

TICK_NS = 5_000_000
MS = 1_000_000
BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 127
NO_OBJECT = 0x06020000
IDENTITY = {(0x1018, 1): 0x526F62, (0x1018, 3): 0x10000, (0x1018, 4): 77}

LIMITS = {(0x2003, 0): 5000, (0x2004, 0): 120, (0x2005, 0): 9000}


class FakeNode:
    """A node of a few objects; `deaf` requests go unanswered, `forgetful` objects ignore writes."""

    def __init__(self, bus, node_id, objects):
        self.bus = bus
        self.node_id = node_id
        self.objects = {**IDENTITY, (0x1018, 2): node_id, **objects}
        self.state = PRE_OPERATIONAL
        self.deaf = 0
        self.forgetful = set()
        self.refusals = {}
        self.requests = []
        self.obeys_nmt = True
        self.alive = True

    def beat(self, state=None):
        if self.alive:
            state = self.state if state is None else state
            self.bus.deliver(0x700 + self.node_id, bytes((state,)))

    def boot(self):
        self.state = PRE_OPERATIONAL
        self.beat(BOOT_UP)

    def on_frame(self, can_id, data):
        if not self.alive:
            return
        if can_id == 0x000 and data[1] == self.node_id and self.obeys_nmt:
            self.state = {1: OPERATIONAL, 2: STOPPED, 128: PRE_OPERATIONAL}[data[0]]
        elif can_id == 0x600 + self.node_id and self.state != STOPPED:
            self.on_request(data)

    def on_request(self, data):
        command, index, subindex, value = struct.unpack("<BHBI", data)
        key = (index, subindex)
        if self.deaf:
            self.deaf -= 1
            return
        self.requests.append((key, value if command != 0x40 else None))
        abort = self.refusals.get(key, None if key in self.objects else NO_OBJECT)
        if abort is not None:
            answer = struct.pack("<BHBI", 0x80, index, subindex, abort)
        elif command == 0x40:
            answer = struct.pack("<BHBI", 0x43, index, subindex, self.objects[key])
        else:
            if key not in self.forgetful:
                self.objects[key] = value
            answer = struct.pack("<BHBI", 0x60, index, subindex, 0)
        self.bus.deliver(0x580 + self.node_id, answer)


class FakeBus:
    """Three nodes and the host; what is delivered arrives with the next tick."""

    def __init__(self, codec, parameters, clock, drive=DIFFERENTIAL):
        self.clock = clock
        self.codec = codec
        self.sent = []
        parts = native_parts(codec, parameters, drive)
        self.port = MemoryPort(self.transmit, parts.identifiers(""), CanConfig(), clock)
        self.robot = native_robot(self.port, parts)
        self.drive = FakeNode(
            self,
            1,
            {
                (0x2000, 0): 250,
                (0x2001, 0): codec.dbc.wire_version,
                (0x2002, 0): 2400,
                (0x1801, 2): 1,
                (0x1802, 2): 1,
                (0x2010, 0): 0,
                (0x1017, 0): 100,
                **LIMITS,
            },
        )
        self.sonar = FakeNode(self, 2, {(0x2200, 0): 8, (0x2201, 0): 20, (0x1017, 0): 100})
        self.power = FakeNode(self, 3, {(0x2300, 0): 10500, (0x2301, 0): 9600, (0x1017, 0): 100})
        self.nodes = [self.drive, self.sonar, self.power]
        self.ticks = 0
        self.feedback = None

    def transmit(self, can_id, data):
        self.sent.append((self.ticks, can_id, data))
        for node in self.nodes:
            node.on_frame(can_id, data)

    def deliver(self, can_id, data):
        self.port.deliver((can_id, data, self.clock.now_ns()))

    def run(self, duration_ms):
        for _ in range(duration_ms * MS // TICK_NS):
            self.ticks += 1
            if self.ticks % 20 == 0:
                for node in self.nodes:
                    node.beat()
            self.clock.sleep_until(self.clock.now_ns() + TICK_NS)
            self.feedback = self.robot.receive(self.clock.now_ns())
            self.robot.send(ActuatorCommand(), self.clock.now_ns())

    def status(self, node_id):
        return next(node for node in self.feedback.nodes if node.node_id == node_id)

    def problems(self):
        return [node.problem for node in self.feedback.nodes]
