"""A stranger's slave, `canopen.LocalNode` with an EDS that is not ours, driven by our host.

The package's network is joined to the host by two lists: no threads, no time.
"""

import struct

import canopen
import pytest

from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.cia402.config import Cia402Motor
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import EmergencyStopSource
from robotctl.messages.faults import FaultCode
from robotctl.model.actuators import Takes
from tests.drivers.can.drives.cia402.rig import BRAKE, FAKE_EDS, OFF, needs

MS = 1_000_000
NODE = 9


class JoinedNetwork(canopen.Network):
    """Gives what the package sends to a function."""

    def __init__(self, deliver):
        super().__init__()
        self.deliver = deliver

    def send_message(self, can_id, data, remote=False):
        self.deliver(can_id, bytes(data))

    def send_periodic(self, can_id, data, period, remote=False):
        class Nothing:
            def stop(self):
                pass

            def update(self, data):
                pass

        return Nothing()


STEPS = {
    (0x40, 0x06): 0x21,
    (0x21, 0x07): 0x23,
    (0x23, 0x0F): 0x27,
    (0x27, 0x0F): 0x27,
    (0x08, 0x80): 0x40,
}
"""Status word behind a control word."""


class Slave:
    """The package's slave with the power states of CiA 402 added by a table of its own.

    Its process data are packed and unpacked by the package, as the host has mapped them by SDO.
    """

    def __init__(self, inbox):
        self.network = JoinedNetwork(lambda can_id, data: inbox.append((can_id, data)))
        self.node = canopen.LocalNode(NODE, FAKE_EDS)
        self.network.add_node(self.node)
        self.state, self.control, self.target, self.position = 0x40, 0, 0, 0
        self.node.nmt.send_command(128)
        self.writes = []
        self.node.add_write_callback(self.on_write)
        self.mapped = False

    def on_write(self, index, subindex, od, data):
        self.writes.append((index, subindex, int.from_bytes(data, "little")))
        if index == 0x6060:
            self.node.sdo[0x6061].raw = data[0]

    def map(self):
        """Take the mapping that is in its dictionary."""
        self.node.rpdo.read(from_od=False)
        self.node.tpdo.read(from_od=False)
        self.mapped = True

    def on_control(self, word):
        if word & 0x8F in (0x00, 0x02) and self.state != 0x08:
            self.state = 0x40
        else:
            self.state = STEPS.get((self.state, word & 0x8F), self.state)
        self.control = word

    def receive(self, can_id, data):
        if can_id == 0x80:
            if self.node.nmt.state == "OPERATIONAL":
                self.send_pdos()
            return
        self.network.notify(can_id, bytearray(data), 0.0)
        if self.node.nmt.state == "OPERATIONAL":
            if not self.mapped:
                self.map()
            for pdo in self.node.rpdo.values():
                if pdo.enabled and pdo.cob_id == can_id:
                    pdo.data[:] = data
                    values = {var.index: var.raw for var in pdo}
                    self.target = values[0x60FF]
                    self.on_control(values[0x6040])

    def send_pdos(self):
        if self.state == 0x27:
            self.position += self.target // 200
        values = {0x6041: self.state | 0x210, 0x6064: self.position,
                  0x606C: self.target if self.state == 0x27 else 0}  # fmt: skip
        for pdo in self.node.tpdo.values():
            if pdo.enabled:
                for var in pdo:
                    var.raw = values[var.index]
                pdo.transmit()

    def beat(self):
        states = {"PRE-OPERATIONAL": 127, "OPERATIONAL": 5, "STOPPED": 4, "INITIALISING": 0}
        self.network.send_message(0x700 + NODE, bytes((states[self.node.nmt.state],)))


class Joined:
    def __init__(self):
        self.inbox = []
        self.slave = Slave(self.inbox)
        table = Cia402Motor(
            "cia402",
            "motor",
            (AxisConfig("left"),),
            NODE,
            eds=FAKE_EDS,
            counts_per_turn=10_000,
            accept_coasting=True,
        )
        self.drive = table.make((Axis(table.axes[0], Takes.SPEED, 4000),), needs())
        self.now_ns = 0
        self.ticks = 0

    def send(self, can_id, data):
        self.slave.receive(can_id, data)
        return True

    def run(self, ms, command):
        for _ in range(ms // 5):
            self.now_ns += 5 * MS
            self.ticks += 1
            if self.ticks % 20 == 0:
                self.slave.beat()
            received, self.inbox[:] = list(self.inbox), []
            for can_id, data in received:
                if can_id in self.drive.handlers:
                    self.drive.handlers[can_id](data, self.now_ns)
            self.drive.check(self.now_ns)
            self.drive.command(self.send, command, self.now_ns)
            self.send(0x80, b"")
            self.drive.serve(self.send, self.now_ns)
        return self

    @property
    def report(self):
        return self.drive.reports[0]


@pytest.fixture
def joined():
    return Joined().run(4000, OFF)


def test_a_stranger_is_commissioned(joined):
    assert joined.drive.status.problem == ""
    sdo = joined.slave.node.sdo
    assert sdo[0x1016][1].raw == 127 << 16 | 100
    assert sdo[0x1029][1].raw == 2
    assert sdo[0x6060].raw == 3
    assert sdo[0x605A].raw == 3
    assert [sdo[0x1600][sub].raw for sub in range(3)] == [2, 0x60400010, 0x60FF0020]
    assert [sdo[0x1A00][sub].raw for sub in range(3)] == [2, 0x60410010, 0x606C0020]
    assert sdo[0x1800][1].raw == 0x40000180 + NODE
    assert sdo[0x1800][2].raw == 1
    assert sdo[0x1803][1].raw >> 31


def test_no_pdo_is_valid_while_its_mapping_changes(joined):
    valid = dict.fromkeys((0x1400, 0x1800, 0x1801), True)
    for index, subindex, value in joined.slave.writes:
        if index in valid and subindex == 1:
            valid[index] = not value >> 31
        if 0x1600 <= index < 0x1604 or 0x1A00 <= index < 0x1A04:
            assert not valid[index - 0x200]
    assert all(valid.values())


def test_a_stranger_is_driven_and_stopped(joined):
    joined.run(200, ActuatorCommand(enable=True, values=(6.2831853,)))
    assert joined.report.state is DriveState.ENABLED
    assert joined.slave.target == 10_000
    assert joined.report.speed_rad_s == pytest.approx(6.2831853)
    before = joined.report.position_ticks
    joined.run(500, ActuatorCommand(enable=True, values=(-6.2831853,)))
    assert joined.report.position_ticks - before == pytest.approx(-2000, abs=50)
    joined.run(50, BRAKE)
    assert joined.slave.state == 0x40
    assert joined.slave.control == 0x02
    assert joined.report.state is DriveState.READY


def test_a_stranger_s_fault_is_cleared_by_an_edge(joined):
    drive = ActuatorCommand(enable=True, values=(1.0,))
    joined.run(200, drive)
    joined.slave.state = 0x08
    joined.inbox.append((0x80 + NODE, struct.pack("<HB5x", 0x3220, 0x05)))
    joined.run(100, drive)
    assert joined.report.fault.code is FaultCode.DRIVE_UNDER_VOLTAGE
    joined.drive.clear_faults()
    joined.run(400, OFF)
    assert joined.slave.state == 0x40
    assert joined.report.fault is None


def test_the_emergency_stop_reaches_a_stranger_at_once(joined):
    joined.run(200, ActuatorCommand(enable=True, values=(1.0,)))
    assert joined.drive.emergency_stop(joined.send, EmergencyStopSource.OPERATOR)
    assert joined.slave.state == 0x40
