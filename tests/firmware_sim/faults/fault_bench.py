"""A robot in the empty room with a host, for tests of faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from e2e import p01

from firmware_sim.simulation import Simulation

CONFIGS = Path(__file__).parents[3] / "configs"
MS = 1_000_000
PERIOD_NS = 5 * MS
COMMAND, FEEDBACK, STATUS, DRIVE_STATUS = 0x201, 0x181, 0x281, 0x381
SONAR_A, SONAR_B, BATTERY = 0x182, 0x282, 0x183
EMCY_DRIVE, HEARTBEAT_DRIVE = 0x081, 0x701
OF_DRIVE = {FEEDBACK, STATUS, DRIVE_STATUS, EMCY_DRIVE, HEARTBEAT_DRIVE}
PARAMETERS_LOST = 0x6310


class Bench:
    """A robot in the empty room with a host that commands it, and an ear on the bus."""

    def __init__(self, robot="diff_drive", start=(2.0, 2.0, 0.0), *, tools=(), name="host"):
        self.simulation = Simulation(
            CONFIGS / f"{robot}.toml", CONFIGS / "worlds" / "empty_room.toml", 1, start
        )
        self.frames, self.wire = [], []
        self.simulation.bus.tap(self.wire.append)
        self.tools = [self.simulation.bus.attach(each, lambda _: None) for each in tools]
        self.port = self.simulation.bus.attach(name, self.frames.append)
        self.counter = 0
        self.run(20)
        self.port.send(0x000, b"\x01\x00")

    def run(self, ms):
        self.simulation.advance(self.simulation.now_ns + round(ms * MS))

    def command(self, duty1=0.0, duty2=0.0, *, enable=True):
        data = bytearray((0, self.counter | enable << 4))
        for value in (duty1, duty2, 0.0):
            data += round(value * 1e4).to_bytes(2, "little", signed=True)
        p01.e2e_p01_protect(data, 0xA201, length=8, increment_counter=False)
        if self.port.send(COMMAND, bytes(data)):
            self.counter = (self.counter + 1) % 15

    def drive(self, seconds, duty1=0.3, duty2=0.3, *, enable=True):
        """Command and SYNC every 5 ms; forget what was heard before."""
        self.frames.clear()
        self.wire.clear()
        for _ in range(round(seconds * 200)):
            self.command(duty1, duty2, enable=enable)
            self.port.send(0x080)
            self.run(5)

    def begin(self, line):
        self.simulation.faults.inject(line)

    def clear(self):
        self.simulation.faults.inject("clear")

    def of(self, identifier):
        return [frame for frame in self.frames if frame.arbitration_id == identifier]

    def on_wire(self, identifier):
        return [frame for frame in self.wire if frame.arbitration_id == identifier]

    def of_drive(self):
        """Frames on the wire that the drive has sent."""
        return [frame for frame in self.wire if frame.arbitration_id in OF_DRIVE]

    def counts(self):
        """Counts of both wheels in each feedback, unrolled from the first on."""
        raw = [np.frombuffer(frame.data[4:8], "<i2").astype(int) for frame in self.of(FEEDBACK)]
        return np.unwrap(np.array(raw), period=65536, axis=0)

    def true_counts(self):
        turn = self.simulation.config.drive.counts_per_revolution
        counts = [axis.encoder(turn).count for axis in self.simulation.plant.axes]
        return np.array((*counts, 0)[:2])

    def stamps_us(self):
        stamps = [int.from_bytes(f.data[:4], "little") >> 12 for f in self.of(FEEDBACK)]
        return np.unwrap(np.array(stamps), period=1 << 20)

    def status(self):
        bits = int.from_bytes(self.of(STATUS)[-1].data, "little")

        def signed(start):
            value = bits >> start & 0xFFF
            return value - 4096 if value & 0x800 else value

        return {
            "state": bits >> 12 & 0xF,
            "current1_a": 0.05 * signed(16),
            "current2_a": 0.05 * signed(28),
            "temperature1_c": (bits >> 40 & 0xFF) - 40,
            "temperature2_c": (bits >> 48 & 0xFF) - 40,
            "faults": bits >> 56 & 0x3F,
        }

    def voltage_v(self):
        return int.from_bytes(self.of(DRIVE_STATUS)[-1].data[4:6], "little") / 1000

    def ranges(self, identifier=SONAR_A):
        """Ranges [m] of each frame of a group of sonars."""
        bits = [int.from_bytes(frame.data, "little") for frame in self.of(identifier)]
        return np.array([[(b >> s & 0x1FFF) / 1000 for s in (12, 25, 38, 51)] for b in bits])

    def read(self, node, index, sub=0):
        request = b"\x40" + index.to_bytes(2, "little") + bytes((sub,)) + bytes(4)
        self.port.send(0x600 + node, request)
        self.frames.clear()
        self.run(5)
        [answer] = self.of(0x580 + node)
        assert answer.data[0] & 0xE3 == 0x43, answer.data.hex()
        return int.from_bytes(answer.data[4 : 8 - (answer.data[0] >> 2 & 3)], "little")

    def write(self, node, index, value, size):
        head = bytes((0x23 | (4 - size) << 2,)) + index.to_bytes(2, "little") + b"\0"
        self.port.send(0x600 + node, head + value.to_bytes(4, "little"))
        self.frames.clear()
        self.run(5)
        [answer] = self.of(0x580 + node)
        assert answer.data[0] == 0x60, answer.data.hex()
