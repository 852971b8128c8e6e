"""The twin alone: the canopen package as its master, and what CiA 301 and 402-2 say of it."""

import heapq
import itertools
import struct

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402, State402
from canopen.sdo.exceptions import SdoAbortedError

from firmware_sim.config.motors import AxisSection
from firmware_sim.drives.cia402.config import Cia402Motor
from firmware_sim.drives.cia402.settings import Cia402Settings
from firmware_sim.drives.cia402.state import State
from firmware_sim.drives.twin import Motor
from firmware_sim.nodes.parameter_store import MemoryStore
from firmware_sim.plant.axis import Limits, Mode

MS = 1_000_000
NODE = 5
EDS = "configs/drives/cia402.eds"
COUNTS = 4096
TURN = 6.283185307179586


class Axis:
    """A wheel that follows each command at once, or stops with a rate of its own."""

    def __init__(self):
        self.mode, self.value = Mode.COAST, 0.0
        self.limits = Limits()
        self.speed_rad_s = self.angle_rad = self.current_a = 0.0
        self.temperature_c = 30.0

    def command(self, mode, value=0.0):
        self.mode, self.value = mode, value

    def step(self, dt_s):
        target, rate = 0.0, 5.0
        if self.mode is Mode.SPEED:
            target, rate = self.value, self.limits.acceleration_rad_s2
        elif self.mode is Mode.BRAKE_CURRENT:
            rate = 200.0
        step = min(rate * dt_s, abs(target - self.speed_rad_s))
        self.speed_rad_s += step if target > self.speed_rad_s else -step
        self.angle_rad += self.speed_rad_s * dt_s

    def encoder(self, counts):
        axis = self

        class Encoder:
            @property
            def count(self):
                return round(axis.angle_rad / TURN * counts)

        return Encoder()


class Stage:
    bus_voltage_v = 24.0


class Line(canopen.Network):
    """The package's network on the twin: frames arrive at once, time passes when told."""

    def __init__(self, dialect="generic", settings=None, axes=2, **table):
        super().__init__()
        self.now_ns, self.steps = 0, 0
        self.wheels = [Axis() for _ in range(axes)]
        sections = tuple(AxisSection(f"wheel{n}", n + 1) for n in range(axes))
        given = {"counts_per_turn": 0 if dialect == "zlac8015d" else COUNTS, **table}
        motor = Cia402Motor("cia402", "motors", sections, NODE, dialect=dialect, **given)
        self.store = MemoryStore()
        self.twin = motor.make(
            settings or Cia402Settings(),
            [Motor(axis, 1.0) for axis in self.wheels],
            Stage(),
            self.run_to,
            self.store,
        )
        self.heard = []
        self._alarms, self._order = [], itertools.count()
        self.twin.connect(
            self, lambda due, _: heapq.heappush(self._alarms, (due, next(self._order)))
        )
        self.twin.power_cycle(0)

    def run_to(self, now_ns):
        while (self.steps + 1) * MS <= now_ns:
            self.steps += 1
            for wheel in self.wheels:
                wheel.step(1e-3)
        return self.steps * MS

    def run(self, ms):
        until_ns = self.now_ns + round(ms * MS)
        while self._alarms and self._alarms[0][0] <= until_ns:
            due_ns, _ = heapq.heappop(self._alarms)
            self.now_ns = max(self.now_ns, due_ns)
            self.twin.wake(self.now_ns)
        self.now_ns = until_ns
        self.run_to(until_ns)
        return self

    # Of the twin's port.
    def send(self, arbitration_id, data):
        self.heard.append((self.now_ns, arbitration_id, bytes(data)))
        self.notify(arbitration_id, bytearray(data), self.now_ns / 1e9)

    # Of the package's network.
    def send_message(self, can_id, data, remote=False):
        self.run(0.5)
        flag = 0x4000_0000 if remote else 0
        frame = type("Frame", (), {})()
        frame.arbitration_id, frame.data, frame.stamp_ns = can_id | flag, bytes(data), self.now_ns
        if frame.arbitration_id in self.twin.arbitration_ids:
            self.twin.on_frame(frame)

    def of(self, arbitration_id):
        return [data for _, each, data in self.heard if each == arbitration_id]

    @property
    def states(self):
        return [axis.state for axis in self.twin.axes]

    @property
    def powered(self):
        return [wheel.mode is not Mode.COAST for wheel in self.wheels]


def master(line, cls=BaseNode402, eds=EDS):
    node = cls(NODE, eds)
    node.sdo.RESPONSE_TIMEOUT = 0.01
    line.add_node(node)
    return node


@pytest.fixture
def line():
    return Line().run(60)


@pytest.fixture
def node(line):
    return master(line)


def enable(node, mode=3):
    node.nmt.send_command(1)
    node.sdo[0x6060].raw = mode
    node.state = "OPERATION ENABLED"
    return node


class TestForeignMaster:
    def test_it_takes_the_twin_through_every_state(self, line, node):
        assert node.state == "SWITCH ON DISABLED"
        for state in ("READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"):
            node.state = state
            assert node.state == state
        assert line.powered == [True, False]
        node.state = "SWITCHED ON"
        assert node.state == "SWITCHED ON"
        node.state = "OPERATION ENABLED"
        node.state = "SWITCH ON DISABLED"
        assert node.state == "SWITCH ON DISABLED"
        assert line.powered == [False, False]

    def test_it_sets_the_mode_and_drives(self, line, node):
        node.nmt.send_command(1)
        node.op_mode = "PROFILED VELOCITY"
        assert node.op_mode == "PROFILED VELOCITY"
        node.state = "OPERATION ENABLED"
        node.sdo[0x6083].raw = 40_960
        node.sdo[0x60FF].raw = COUNTS
        line.run(1000)
        assert node.sdo[0x606C].raw == pytest.approx(COUNTS, abs=2)
        start = node.sdo[0x6064].raw
        line.run(1000)
        assert node.sdo[0x6064].raw - start == pytest.approx(COUNTS, rel=0.01)

    def test_it_maps_pdos_and_drives_by_them(self, line, node):
        node.nmt.send_command(128)
        node.rpdo.read()
        node.tpdo.read()
        node.rpdo[1].clear()
        node.rpdo[1].add_variable(0x6040)
        node.rpdo[1].add_variable(0x60FF)
        node.rpdo[1].enabled = True
        node.tpdo[1].clear()
        node.tpdo[1].add_variable(0x6041)
        node.tpdo[1].add_variable(0x606C)
        node.tpdo[1].trans_type = 1
        node.tpdo[1].enabled = True
        node.rpdo[1].save()
        node.tpdo[1].save()
        enable(node)
        node.rpdo[1][0].raw, node.rpdo[1][1].raw = 0x0F, -2 * COUNTS
        node.rpdo[1].transmit()
        line.run(2000)
        line.send_message(0x80, b"")
        assert node.tpdo[1][0].raw & 0x6F == 0x27
        assert node.tpdo[1][1].raw == pytest.approx(-2 * COUNTS, abs=2)

    def test_a_fault_is_reset_by_an_edge_once_its_cause_is_over(self, line, node, monkeypatch):
        monkeypatch.setattr(BaseNode402, "TIMEOUT_RESET_FAULT", 0.01)
        enable(node)
        line.twin.trip(0x3210)
        line.run(500)
        assert node.is_faulted()
        assert node.sdo[0x603F].raw == 0x3210
        [emergency] = line.of(0x80 + NODE)
        assert struct.unpack_from("<H", emergency) == (0x3210,)
        node.sdo[0x6040].raw = State402.CW_SWITCH_ON_DISABLED
        assert node.is_faulted(), "the cause is still there"
        line.twin.heal()
        node.sdo[0x6040].raw = State402.CW_SWITCH_ON_DISABLED
        assert node.is_faulted(), "a level is no edge"
        node.sdo[0x6040].raw = 0
        node.sdo[0x6040].raw = State402.CW_SWITCH_ON_DISABLED
        assert node.state == "SWITCH ON DISABLED"
        assert node.sdo[0x603F].raw == 0

    def test_all_objects_of_the_eds_can_be_read(self, node):
        read = 0
        for each in node.object_dictionary.values():
            for variable in each.values() if hasattr(each, "values") else [each]:
                if variable.readable:
                    assert len(node.sdo.upload(variable.index, variable.subindex)) == (
                        len(variable) // 8
                    )
                    read += 1
        assert read > 150


class TestStops:
    def drive(self, line, node, speed=4 * COUNTS):
        enable(node)
        for index in (0x6083, 0x6084, 0x6085):
            node.sdo[index].raw = 10 * COUNTS
        node.sdo[0x60FF].raw = speed
        line.run(1000)
        assert line.wheels[0].speed_rad_s == pytest.approx(speed / COUNTS * TURN, rel=0.01)

    @pytest.mark.parametrize(
        ("option", "ends", "rest_ms"),
        [
            (0, State.SWITCH_ON_DISABLED, 5000),
            (1, State.SWITCH_ON_DISABLED, 405),
            (2, State.SWITCH_ON_DISABLED, 405),
            (3, State.SWITCH_ON_DISABLED, 185),
            (6, State.QUICK_STOP_ACTIVE, 405),
        ],
    )
    def test_quick_stop_does_what_605a_says(self, line, node, option, ends, rest_ms):
        self.drive(line, node)
        node.sdo[0x605A].raw = option
        node.sdo[0x6040].raw = State402.CW_QUICK_STOP
        assert line.states[0] is (
            State.SWITCH_ON_DISABLED if option == 0 else State.QUICK_STOP_ACTIVE
        )
        line.run(rest_ms)
        assert line.states[0] is ends
        assert abs(line.wheels[0].speed_rad_s) < 0.5 or option == 0
        assert line.powered[0] is (option > 4)

    @pytest.mark.parametrize("option", [0, 2, 3])
    def test_fault_reaction_does_what_605e_says(self, line, node, option):
        self.drive(line, node)
        node.sdo[0x605E].raw = option
        line.twin.trip(0x2310)
        assert line.states[0] is (State.FAULT if option == 0 else State.FAULT_REACTION_ACTIVE)
        line.run(450)
        assert line.states[0] is State.FAULT
        assert not line.powered[0]

    def test_halt_stops_with_power_and_goes_on(self, line, node):
        self.drive(line, node)
        node.sdo[0x6040].raw = 0x10F
        line.run(450)
        assert line.wheels[0].speed_rad_s == pytest.approx(0.0, abs=0.01)
        assert line.states[0] is State.OPERATION_ENABLED
        node.sdo[0x6040].raw = 0x0F
        line.run(450)
        assert line.wheels[0].speed_rad_s == pytest.approx(4 * TURN, rel=0.01)

    def test_shutdown_and_disable_operation_do_what_605b_and_605c_say(self, line, node):
        self.drive(line, node)
        node.sdo[0x605C].raw = 1
        node.sdo[0x6040].raw = 0x07
        assert line.states[0] is State.SWITCHED_ON
        assert line.powered[0]
        line.run(450)
        assert not line.powered[0]
        self.drive(line, node)
        node.sdo[0x605B].raw = 0
        node.sdo[0x6040].raw = 0x06
        assert (line.states[0], line.powered[0]) == (State.READY_TO_SWITCH_ON, False)

    def test_beyond_its_speed_the_drive_says_that_it_is_limited(self):
        line = Line(settings=Cia402Settings(speed_max_rad_s=10.0)).run(60)
        node = master(line)
        self.drive(line, node, COUNTS)
        assert not node.statusword & 0x800
        node.sdo[0x60FF].raw = 100 * COUNTS
        line.run(1000)
        assert node.statusword & 0x800
        assert line.wheels[0].speed_rad_s == pytest.approx(10.0)


class TestSilentHost:
    def consume(self, line, node, abort=1, behaviour=1, ms=100):
        enable(node)
        node.sdo[0x1016][1].raw = 127 << 16 | ms
        node.sdo[0x1029][1].raw = behaviour
        node.sdo[0x6007].raw = abort
        node.sdo[0x605E].raw = 0
        node.sdo[0x605A].raw = 3
        node.sdo[0x60FF].raw = COUNTS
        line.run(200)
        assert line.states[0] is State.OPERATION_ENABLED, "it waits for the first heartbeat"

    @pytest.mark.parametrize(
        ("abort", "state"),
        [
            (0, State.OPERATION_ENABLED),
            (1, State.FAULT),
            (2, State.SWITCH_ON_DISABLED),
            (3, State.SWITCH_ON_DISABLED),
        ],
    )
    def test_after_its_time_the_drive_does_what_6007_says(self, line, node, abort, state):
        self.consume(line, node, abort)
        for _ in range(5):
            line.send_message(0x77F, b"\x05")
            line.run(90)
        assert line.states[0] is State.OPERATION_ENABLED
        line.run(9)
        assert line.states[0] is State.OPERATION_ENABLED
        line.run(150)
        assert line.states[0] is state
        assert struct.unpack_from("<H", line.of(0x80 + NODE)[-1]) == (0x8130,)

    @pytest.mark.parametrize(("behaviour", "nmt"), [(0, 127), (1, 5), (2, 4)])
    def test_and_its_nmt_state_is_what_1029_says(self, line, node, behaviour, nmt):
        self.consume(line, node, behaviour=behaviour)
        line.send_message(0x77F, b"\x05")
        line.run(150)
        assert line.twin.nmt_state == nmt

    def test_another_node_s_heartbeat_is_not_the_host_s(self, line, node):
        self.consume(line, node)
        line.send_message(0x77F, b"\x05")
        for _ in range(5):
            line.send_message(0x77E, b"\x05")
            line.run(40)
        assert line.states[0] is State.FAULT

    def test_node_guarding(self, line, node):
        enable(node)
        node.sdo[0x100C].raw = 50
        node.sdo[0x100D].raw = 2
        node.sdo[0x6007].raw = 2
        for _ in range(4):
            line.send_message(0x700 + NODE, b"", remote=True)
            line.run(90)
        assert [data[0] for data in line.of(0x700 + NODE)[-4:]] == [0x05, 0x85, 0x05, 0x85]
        assert line.states[0] is State.OPERATION_ENABLED
        line.run(20)
        assert line.states[0] is State.SWITCH_ON_DISABLED

    def test_there_is_no_node_guarding_beside_a_heartbeat(self, line, node):
        node.sdo[0x1017].raw = 1000
        line.send_message(0x700 + NODE, b"", remote=True)
        assert line.of(0x700 + NODE) == [b"\0"]

    @pytest.mark.parametrize("reaction", ["brake", "coast", "fault"])
    @pytest.mark.parametrize("frames", ["all", "commands"])
    def test_a_zlac8015d_has_its_off_line_time(self, reaction, frames):
        settings = Cia402Settings(off_line_reaction=reaction, off_line_frames=frames)
        line = Line("zlac8015d", settings).run(60)
        send = line.send_message
        for request in ("2b40600006000000", "2b40600007000000", "2b4060000f000000"):
            send(0x600 + NODE, bytes.fromhex("2f60600003000000"))
            send(0x600 + NODE, bytes.fromhex(request))
        send(0x600 + NODE, bytes.fromhex("23ff6003 0a00 f6ff".replace(" ", "")))
        line.run(800)
        assert [round(wheel.speed_rad_s / TURN * 60) for wheel in line.wheels] == [10, -10]
        assert line.powered == [True, True], "its default is 0: off"
        send(0x000, bytes((1, NODE)))
        send(0x600 + NODE, bytes.fromhex("2b00200064000000"))
        send(0x200 + NODE, b"")
        for _ in range(30):
            line.run(5)
            send(0x80, b"")
        goes_on = line.states == [State.OPERATION_ENABLED] * 2
        assert goes_on is (frames == "all")
        line.run(400)
        assert line.powered == [False, False]
        expected = State.FAULT if reaction == "fault" else State.SWITCH_ON_DISABLED
        assert line.states == [expected] * 2


class TestNode:
    def test_it_boots_and_beats(self, line, node):
        assert line.heard[0] == (50 * MS, 0x700 + NODE, b"\0")
        node.sdo[0x1017].raw = 100
        line.run(1001)
        assert len(line.of(0x700 + NODE)) == 11
        node.nmt.send_command(129)
        line.run(60)
        assert line.of(0x700 + NODE)[-1] == b"\0"
        assert node.sdo[0x1017].raw == 0

    def test_saved_settings_outlive_the_supply_and_others_do_not(self, line, node):
        node.sdo[0x1017].raw = 70
        node.sdo[0x1010][1].raw = 0x65766173
        node.sdo[0x605A].raw = 3
        line.twin.reboot(line.now_ns)
        line.run(60)
        assert node.sdo[0x1017].raw == 70
        assert node.sdo[0x605A].raw == 2

    def test_a_reboot_takes_the_power(self, line, node):
        enable(node)
        line.twin.reboot(line.now_ns)
        assert line.powered == [False, False]
        assert line.states == [State.NOT_READY_TO_SWITCH_ON] * 2
        line.run(60)
        assert line.states == [State.SWITCH_ON_DISABLED] * 2

    def test_pdos_are_for_operational_only_and_short_ones_are_reported(self, line, node):
        node.sdo[0x1600][0].raw = 0
        node.sdo[0x1600][1].raw = 0x60400010
        node.sdo[0x1600][0].raw = 1
        node.sdo[0x1400][1].raw = 0x200 + NODE
        line.send_message(0x200 + NODE, b"\x06\x00")
        assert line.states[0] is State.SWITCH_ON_DISABLED
        node.nmt.send_command(1)
        line.send_message(0x200 + NODE, b"\x06")
        assert line.states[0] is State.SWITCH_ON_DISABLED
        assert struct.unpack_from("<H", line.of(0x80 + NODE)[-1]) == (0x8210,)
        line.send_message(0x200 + NODE, b"\x06\x00")
        assert line.states[0] is State.READY_TO_SWITCH_ON

    def test_synchronous_rpdos_hold_from_the_next_sync(self, line, node):
        node.sdo[0x1600][1].raw = 0x60400010
        node.sdo[0x1600][0].raw = 1
        node.sdo[0x1400][2].raw = 1
        node.sdo[0x1400][1].raw = 0x200 + NODE
        node.nmt.send_command(1)
        line.send_message(0x200 + NODE, b"\x06\x00")
        assert line.states[0] is State.SWITCH_ON_DISABLED
        line.send_message(0x80, b"")
        assert line.states[0] is State.READY_TO_SWITCH_ON

    def test_a_zlac8015d_s_event_timer_counts_half_milliseconds(self):
        line = Line("zlac8015d").run(60)
        for request in ("2f001a0000", "23001a0120004160", "2f001a0001", "2f001802ff",
                        "2b00180528", "2300180185010000"):  # fmt: skip
            line.send_message(0x600 + NODE, bytes.fromhex(request).ljust(8, b"\0"))
        line.send_message(0, bytes((1, NODE)))
        line.heard.clear()
        line.run(200)
        assert len(line.of(0x180 + NODE)) == 10  # 28h are 20 ms

    def test_objects_that_a_firmware_lacks_are_not_there(self):
        line = Line(settings=Cia402Settings(lacks=("6007",), stop_options=(2,))).run(60)
        node = master(line)
        with pytest.raises(SdoAbortedError, match="0x06020000"):
            node.sdo[0x6007].raw = 1
        with pytest.raises(SdoAbortedError, match="0x06090030"):
            node.sdo[0x605A].raw = 3
