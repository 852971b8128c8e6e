"""CiA 301 services that all nodes share: NMT, boot-up, heartbeat, EMCY, stored parameters."""

from __future__ import annotations

import pytest

from firmware_sim.nodes.node import Node, Trouble
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.parameter_store import FileStore
from firmware_sim.nodes.standard_objects import standard_objects
from firmware_sim.nodes.variables import Access, DataType, variable

MS = 1_000_000
HOT = Trouble(0x4310, 0x09)
LOW = Trouble(0x3220, 0x05)


def make_node(line, node_id=5, store=None):
    parameter = variable(
        0x2000, "p", DataType.UNSIGNED16, Access.RW, 10, low=1, high=99, stored=True
    )
    dictionary = ObjectDictionary([*standard_objects(node_id, "test node", 9), parameter])
    return line.add(Node(node_id, "test", dictionary, store))


def sdo(line, request, node_id=5):
    before = len(line.sent)
    line.deliver(0x600 + node_id, bytes.fromhex(request))
    return [f.data for f in line.sent[before:] if f.arbitration_id == 0x580 + node_id]


def write(line, head, value):
    return sdo(line, head + value.to_bytes(4, "little").hex())


def save(line):
    return write(line, "23101001", 0x65766173)


def states(line):
    return [frame.data[0] for frame in line.frames(0x705)]


class TestNmt:
    def test_a_node_boots_says_so_and_beats_from_then_on(self, line):
        make_node(line)
        line.run_ms(520)
        beats = line.frames(0x705)
        assert [frame.data for frame in beats] == [b"\x00"] + [b"\x7f"] * 5
        assert [frame.stamp_ns for frame in beats] == [(9 + 100 * n) * MS for n in range(6)]

    @pytest.mark.parametrize(("command", "state"), [(1, 5), (2, 4), (128, 127)])
    @pytest.mark.parametrize("address", [0, 5])
    def test_nmt_commands_lead_to_their_states(self, line, command, state, address):
        make_node(line)
        line.run_ms(10)
        line.deliver(0, bytes((1 if command == 128 else command, address)))
        line.deliver(0, bytes((command, address)))
        line.run_ms(100)
        assert states(line)[-1] == state

    @pytest.mark.parametrize(
        "data", [b"\x01\x06", b"\x01", b"", b"\x01\x05\x00", b"\x07\x05", b"\x00\x00"]
    )
    def test_what_is_no_command_for_this_node_changes_nothing(self, line, data):
        node = make_node(line)
        line.run_ms(10)
        line.deliver(0, data)
        assert node.state.name == "PRE_OPERATIONAL"

    @pytest.mark.parametrize("command", [129, 130])
    def test_a_reset_boots_again(self, line, command):
        node = make_node(line)
        line.run_ms(50)
        line.deliver(0, bytes((command, 5)))
        assert node.state.name == "INITIALISING"
        line.deliver(0, b"\x01\x05")
        line.run_ms(10)
        assert states(line) == [0, 0]
        assert node.state.name == "PRE_OPERATIONAL"

    def test_sdo_is_answered_before_and_in_operational_but_not_when_stopped(self, line):
        make_node(line)
        assert sdo(line, "4000100000000000") == []
        line.run_ms(10)
        assert len(sdo(line, "4000100000000000")) == 1
        line.deliver(0, b"\x01\x00")
        assert len(sdo(line, "4000100000000000")) == 1
        line.deliver(0, b"\x02\x00")
        assert sdo(line, "4000100000000000") == []


class TestHeartbeat:
    def test_its_time_can_be_set_and_counts_from_the_write(self, line):
        make_node(line)
        line.run_ms(50)
        sdo(line, "2b17100007000000")
        line.run_ms(36)
        assert [f.stamp_ns for f in line.frames(0x705)[1:]] == [
            (50 + 7 * n) * MS for n in range(1, 6)
        ]

    def test_zero_stops_it_and_another_value_starts_it_again(self, line):
        make_node(line)
        line.run_ms(50)
        sdo(line, "2b17100000000000")
        line.run_ms(1000)
        assert len(states(line)) == 1
        sdo(line, "2b171000f4010000")
        line.run_ms(1000)
        assert len(states(line)) == 3


class TestEmergencies:
    def test_an_error_is_told_when_it_appears_and_when_it_is_over(self, line):
        node = make_node(line)
        line.run_ms(10)
        node.report(HOT, b"\x02\x01")
        node.report(HOT)
        node.report(LOW)
        node.retract(HOT)
        node.retract(HOT)
        node.retract(LOW)
        assert [frame.data.hex() for frame in line.frames(0x085)] == [
            "1043090201000000",
            "20320d0000000000",
            "0000050000000000",
            "0000000000000000",
        ]

    def test_the_history_has_the_newest_first_and_can_be_cleared(self, line):
        node = make_node(line)
        line.run_ms(10)
        assert sdo(line, "4003100000000000") == [bytes.fromhex("4f03100000000000")]
        assert sdo(line, "4003100100000000") == [bytes.fromhex("8003100124000008")]
        for _ in range(6):
            for trouble in (HOT, LOW):
                node.report(trouble)
                node.retract(trouble)
        assert sdo(line, "4003100000000000")[0][4] == 8
        assert sdo(line, "4003100100000000")[0][4:] == bytes.fromhex("20320000")
        assert sdo(line, "4003100200000000")[0][4:] == bytes.fromhex("10430000")
        assert sdo(line, "2f03100005000000")[0].hex() == "8003100030000906"
        assert sdo(line, "2f03100000000000")[0][0] == 0x60
        assert sdo(line, "4003100000000000")[0][4] == 0

    def test_a_stopped_node_keeps_quiet(self, line):
        node = make_node(line)
        line.run_ms(10)
        line.deliver(0, b"\x02\x00")
        node.report(HOT)
        assert line.frames(0x085) == []
        assert node.error_register == 0x09

    def test_errors_that_stand_over_a_reset_are_told_after_boot_up(self, line):
        node = make_node(line)
        line.run_ms(10)
        line.deliver(0, b"\x81\x00")
        node.report(HOT)
        line.run_ms(20)
        sent = [f.arbitration_id for f in line.sent if f.arbitration_id in {0x705, 0x085}]
        assert sent == [0x705, 0x705, 0x085]


class TestStoredParameters:
    @pytest.fixture
    def store(self, tmp_path):
        return FileStore(tmp_path, "test")

    def value(self, line):
        return sdo(line, "4000200000000000")[0][4]

    def boot(self, line, node):
        node.power_cycle(line.now_ns)
        line.run_ms(20)

    def test_what_was_saved_survives_a_power_cycle_what_was_not_does_not(self, line, store):
        node = make_node(line, store=store)
        line.run_ms(10)
        sdo(line, "2b0020002a000000")
        self.boot(line, node)
        assert self.value(line) == 10
        sdo(line, "2b0020002a000000")
        assert save(line)[0][0] == 0x60
        sdo(line, "2b0020002b000000")
        self.boot(line, node)
        assert self.value(line) == 42

    def test_memory_alone_survives_a_power_cycle_too(self, line):
        node = make_node(line)
        line.run_ms(10)
        sdo(line, "2b0020002a000000")
        save(line)
        self.boot(line, node)
        assert self.value(line) == 42

    def test_defaults_come_back_at_the_next_start_after_load(self, line, store):
        node = make_node(line, store=store)
        line.run_ms(10)
        sdo(line, "2b0020002a000000")
        save(line)
        assert write(line, "23111001", 0x64616F6C)[0][0] == 0x60
        assert self.value(line) == 42
        self.boot(line, node)
        assert self.value(line) == 10

    @pytest.mark.parametrize("head", ["23101001", "23111001"])
    def test_a_wrong_signature_is_refused(self, line, store, head):
        make_node(line, store=store)
        line.run_ms(10)
        assert write(line, head, 0x12345678)[0][4:] == bytes.fromhex("20000008")

    @pytest.mark.parametrize("content", [b"rubbish", b'{"values": {"2000:00": 70}, "crc32": 0}'])
    def test_a_damaged_file_means_defaults_and_an_emergency(self, line, store, content):
        store.path.write_bytes(content)
        make_node(line, store=store)
        line.run_ms(20)
        assert self.value(line) == 10
        assert [f.data.hex() for f in line.frames(0x085)] == ["1063010000000000"]

    @pytest.mark.parametrize("values", [{(0x2000, 0): 100}, {(0x2000, 0): 7, (0x1000, 0): 1}])
    def test_a_file_of_another_firmware_means_defaults_and_an_emergency(self, line, store, values):
        store.save(values)
        make_node(line, store=store)
        line.run_ms(20)
        assert self.value(line) == 10
        assert len(line.frames(0x085)) == 1

    def test_a_disk_that_cannot_be_written_aborts_with_a_hardware_error(
        self, line, store, monkeypatch
    ):
        make_node(line, store=store)
        line.run_ms(10)

        def full(_values):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(store, "save", full)
        assert save(line)[0][4:] == bytes.fromhex("00000606")


@pytest.mark.parametrize("stored", [(0x1010, b"save"), (0x1011, b"load")])
def test_the_drive_reports_damaged_parameters_until_they_are_stored_anew(
    make_rig, tmp_path, stored
):
    store = FileStore(tmp_path, "drive")
    store.path.write_bytes(b"{")
    rig = make_rig(store)

    def reports():
        for _ in range(4):
            rig.line.deliver(0x080)
        return rig.last("MotorStatus")["FaultParameter"]

    assert reports() == 1
    assert rig.last("MotorStatus")["State"] == 1
    rig.clear_faults()
    assert reports() == 1
    emergencies = len(rig.line.frames(0x081))
    index, signature = stored
    rig.write(index, 1, int.from_bytes(signature, "little"), 4)
    assert reports() == 0
    [over] = rig.line.frames(0x081)[emergencies:]
    assert over.data[:2] == b"\0\0"
    rig.drive.power_cycle(rig.line.now_ns)
    rig.line.run_ms(6)
    rig.line.deliver(0x000, b"\x01\x00")
    assert reports() == 0
