"""`Scanner` against twins on a simulated bus, in virtual time: who is there, and what is wrong."""

from __future__ import annotations

import tomllib

import pytest

from firmware_sim.bus.errors import BusError
from firmware_sim.bus.faults import Cut, Destroy, Dominant, Unanswered
from firmware_sim.bus.state import FdSupport
from robotctl.app.simulation.lockstep_stack import attach_port
from robotctl.config.robot_file import config_directory, load_robot
from robotctl.drivers.can.drives.axis import AxisConfig
from robotctl.drivers.can.drives.registry import DRIVES
from robotctl.drivers.can.drives.vesc.config import VescMotor
from robotctl.drivers.can.nodes.scan import CanopenProbe
from robotctl.drivers.can.probe import Found
from robotctl.drivers.can.scan_tables import motor_tables
from robotctl.drivers.can.scanner import LISTEN_NS, Scanner, Verdict, all_probes
from robotctl.errors import InvalidValue
from robotctl.messages.ports import REMOTE_FLAG
from tests.drivers.can.drives.drive_rig import DriveRig
from tests.drivers.can.drives.scan_bench import MS, ScanBench

LIMIT_MS = 2000.0
QUIET = {"heartbeat_ms": 0, "encoder_ms": 0}
"""An ODrive that sends nothing by itself."""


def numbers(report):
    """Protocol and number of all that was found."""
    return {(each.protocol, each.number) for each in report.found}


def test_all_five_kinds_are_found_on_one_bus_of_can_fd_with_our_nodes():
    bench = ScanBench(native=True, data_bitrate=5_000_000)
    bench.add("odrive", 33)
    bench.add("vesc", 10)
    bench.add("moteus", 1, settings={"serial": (0x11, 0x22, 0x33)})
    bench.add("cia402", 20, dialect="zlac8015d", settings={"vendor": 0x100, "product": 0x8015})
    report = bench.scan()
    assert report.verdict is Verdict.FOUND
    assert not report.error_frames
    assert not report.not_asked
    assert report.duration_ms <= LIMIT_MS
    found = {(each.kind or each.name, each.number): each for each in report.found}
    assert set(found) == {
        *(("native", 1), ("cia402", 20), ("odrive", 33), ("vesc", 10), ("moteus", 1)),
        *(("sonar", 2), ("power", 3)),
    }
    assert found["native", 1].firmware == "1.0"
    assert found["cia402", 20].keys == {"dialect": "zlac8015d"}
    assert found["cia402", 20].state == "switch on disabled"
    assert found["cia402", 20].name == "vendor 0x100, product 0x8015"
    assert (found["odrive", 33].firmware, found["odrive", 33].state) == ("0.6.10", "idle")
    assert (found["vesc", 10].firmware, found["vesc", 10].name) == ("6.05", "60_MK6")
    assert (found["moteus", 1].firmware, found["moteus", 1].state) == ("0.1.9", "stopped")
    assert found["moteus", 1].name == "serial 000000330000002200000011"


def test_names_longer_than_a_frame_are_read_in_segments():
    bench = ScanBench(native=True)
    bench.advance(700)
    probe = CanopenProbe(lambda device: Found("any", device.node_id, name=device.name))
    port = attach_port(bench.bus, bench.config, None, bench)
    report = Scanner(port, bench.config, bench, [probe]).run()
    names = {each.number: each.name for each in report.found}
    for node in bench.simulation.nodes:
        if node.node_id in names:
            assert names[node.node_id] == node.dictionary.upload(0x1008, 0).decode()
    assert len(names) == 3
    assert max(map(len, names.values())) > 7


def test_a_table_that_would_coast_is_refused_until_its_owner_says_how_it_brakes():
    bench = ScanBench()
    bench.add("vesc", 10)
    (table,) = tomllib.loads(motor_tables(bench.scan().found))["motor"]
    table["axes"] = tuple(AxisConfig(**each) for each in table["axes"])
    with pytest.raises(InvalidValue, match="coasts when the host dies"):
        VescMotor(**table)
    assert VescMotor(**{**table, "brake_current_a": 10.0}).abilities.brakes


def test_each_kind_of_drive_has_a_probe_of_its_own():
    assert len(all_probes()) == len(DRIVES) + 1
    probes = [kind.probe() for kind in DRIVES]
    assert len({id(each) for each in probes}) == len(DRIVES)


@pytest.mark.parametrize("bitrate", [250_000, 1_000_000])
@pytest.mark.parametrize("numbers_", [(0, 1, 3, 5), (16, 33, 47, 62)])
def test_four_odrives_of_both_firmwares_are_found_within_two_seconds(bitrate, numbers_):
    bench = ScanBench(bitrate=bitrate)
    for number in numbers_:
        old = number == numbers_[2]
        bench.add("odrive", number, settings={"firmware": (0, 5, 6)} if old else None)
    report = bench.scan()
    assert report.verdict is Verdict.FOUND
    assert report.duration_ms <= LIMIT_MS
    assert numbers(report) == {("ODrive", number) for number in numbers_}
    firmwares = [each.firmware for each in report.found]
    assert firmwares == ["0.6.10", "0.6.10", "0.5", "0.6.10"]


def test_an_odrive_that_would_answer_like_a_canopen_host_is_only_listened_to():
    """While ODrives 48 and 51 keep CANopen nodes from being asked, those may be there."""
    bench = ScanBench()
    for number in (48, 51, 59):
        bench.add("odrive", number)
    report = bench.scan()
    assert numbers(report) == {("ODrive", 48), ("ODrive", 51), ("ODrive", 59)}
    assert report.found[2].firmware == ""
    assert report.not_asked == ("CANSimple 59",)


def test_drives_that_send_nothing_by_themselves_are_found():
    bench = ScanBench()
    for number in (0, 44, 48):
        bench.add("odrive", number, settings=QUIET)
    bench.add("vesc", 200, settings={"status": ()})
    bench.add("cia402", 10, counts_per_turn=4096)
    report = bench.scan()
    assert numbers(report) == {
        *(("ODrive", 0), ("ODrive", 44), ("ODrive", 48), ("VESC", 200), ("CiA 402", 10)),
    }
    assert "no heartbeat" in report.found[1].state


def test_vescs_are_found_whatever_their_numbers():
    bench = ScanBench()
    for number in (0, 7, 128, 254):
        bench.add("vesc", number, settings={"status": (1, 5)})
    report = bench.scan()
    assert numbers(report) == {("VESC", number) for number in (0, 7, 128, 254)}
    assert {each.firmware for each in report.found} == {"6.05"}
    assert report.duration_ms <= LIMIT_MS


def test_states_and_faults_are_told_in_words():
    bench = ScanBench(data_bitrate=5_000_000)
    odrive, vesc, moteus, cia402 = (
        bench.add("odrive", 33),
        bench.add("vesc", 1, settings={"fault_stop_ms": 60_000}),
        bench.add("moteus", 2),
        bench.add("cia402", 20, counts_per_turn=4096),
    )
    bench.advance(700)
    odrive.trip(0x200)
    vesc.trip(2)
    moteus.trip(38)
    cia402.trip(0x3210)
    bench.advance(200)
    states = {each.kind: each.state for each in bench.scanner().run().found}
    assert states["odrive"] == "idle, error 0x200"
    assert "under voltage" in states["vesc"]
    assert "over temperature" in states["moteus"]
    assert states["cia402"].startswith("fault")


# A running controller ---------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ["diff_drive", "odrive", "vesc_car", "moteus", "zlac8015d"])
def test_where_a_controller_runs_nothing_is_asked(robot):
    rig = DriveRig(robot).commission()
    bus = rig.config.buses[0]
    bench = ScanBench(bitrate=bus.bitrate, data_bitrate=bus.data_bitrate)
    bench.bus = rig.simulation.buses[bus.name]
    bench.bus.ports[-1].detach()  # the host, of which there is one; its frames come from another
    bench.simulation = Driven(rig)
    report = bench.scanner().run()
    assert report.verdict is Verdict.DRIVEN
    assert report.found
    assert report.duration_ms == pytest.approx(LISTEN_NS / MS, abs=5.0)
    assert "a controller is running" in report.text


class Driven:
    """The simulation of a rig whose host goes on while time passes, under another name."""

    def __init__(self, rig):
        self._rig = rig
        bus = rig.simulation.buses[rig.config.buses[0].name]
        self._port = bus.attach("controller", lambda _: None)
        port = next(iter(rig.robot._buses)).port
        port.transmit = self._send
        self._next_ns = rig.simulation.now_ns

    def _send(self, number, data):
        fd = 1 << 33 if number >> 32 else 0
        return self._port.send(number | fd, data)

    def advance(self, until_ns):
        rig = self._rig
        while self._next_ns <= until_ns:
            rig.simulation.advance(self._next_ns)
            rig.robot.send(rig.command(0.5), self._next_ns)
            self._next_ns += rig.period_ns
        rig.simulation.advance(until_ns)


def test_who_only_listens_sends_nothing():
    bench = ScanBench()
    bench.add("odrive", 3)
    bench.advance(700)
    scanner = bench.scanner()
    report = scanner.run(only_listen=True)
    assert report.verdict is Verdict.DRIVEN
    assert numbers(report) == {("ODrive", 3)}
    assert bench.bus.ports[-1].statistics.sent == 0


# Two devices with one number --------------------------------------------------------------------


def two_of(kind, number, first, second, *, data_bitrate=0, later_ms=0.0, **keys):
    """Report on a bus with two devices of one number, the second switched on later."""
    bench = ScanBench(data_bitrate=data_bitrate)
    bench.add(kind, number, settings=first, **keys)
    twin = bench.add(kind, number, settings=second, on=False, **keys)
    bench.advance(later_ms)
    bench.plug(twin)
    return bench.scan()


CLASHES = [
    ("odrive", 0, {}, {}, {"later_ms": 30.0}),
    ("odrive", 7, QUIET, {**QUIET, "firmware": (0, 6, 9)}, {}),
    ("cia402", 5, {"vendor": 1}, {"vendor": 2}, {"dialect": "zlac8015d"}),
    ("moteus", 9, {}, {"serial": (2, 0, 0)}, {"data_bitrate": 5_000_000}),
    ("vesc", 3, {"status": (1,)}, {"status": (1,)}, {"later_ms": 1.0}),
    ("vesc", 3, {"status": ()}, {"status": (), "firmware": (5, 3)}, {}),
]


@pytest.mark.parametrize(("kind", "number", "first", "second", "more"), CLASHES)
def test_two_devices_with_one_number_are_told(kind, number, first, second, more):
    report = two_of(kind, number, first, second, **more)
    assert report.verdict is Verdict.CLASH
    assert not report.is_good
    (found,) = report.found
    assert found.number == number
    assert f"{found.protocol} {number}: " in report.text
    assert "another number" in report.fix


# Nobody there, or not as it should be -----------------------------------------------------------


def test_an_empty_bus_says_that_nobody_acknowledges():
    report = ScanBench().scan()
    assert report.verdict is Verdict.ALONE
    assert "terminator" in report.text
    assert "120 ohm" in report.fix


def test_a_silent_device_is_told_from_an_empty_bus():
    bench = ScanBench()
    bench.bus.attach("stranger", lambda _: None)
    report = bench.scan()
    assert report.verdict is Verdict.SILENT
    assert not report.error_frames
    assert report.duration_ms <= LIMIT_MS


@pytest.mark.parametrize("fault", [Cut(node="host"), Unanswered(node="host")])
def test_own_frames_that_nobody_acknowledges_are_told(fault):
    bench = ScanBench()
    bench.add("vesc", 3, settings={"status": (), "notifies_boot": False})
    bench.bus.inject(fault)
    assert bench.scan().verdict is Verdict.ALONE


def test_a_wrong_bit_rate_shows_as_error_frames_alone_and_nothing_is_sent():
    bench = ScanBench()
    bench.add("odrive", 3)
    bench.bus.inject(Destroy(error=BusError.BIT_STUFFING_ERROR, receiver="host"))
    bench.bus.inject(Destroy(node="host", error=BusError.BIT_ERROR))
    report = bench.scan()
    assert report.verdict is Verdict.WRONG_BITRATE
    assert "1000000" in report.text
    assert "bit rate" in report.fix
    assert bench.bus.ports[-1].statistics.sent == 0


def test_a_wrong_bit_rate_towards_a_silent_drive_ends_in_bus_off():
    bench = ScanBench()
    bench.add("vesc", 3, settings={"status": (), "notifies_boot": False})
    bench.bus.inject(Destroy(node="host", error=BusError.BIT_ERROR))
    report = bench.scan()
    assert report.verdict is Verdict.DESTROYED
    assert "bit rate" in report.text


def test_a_short_circuit_lets_no_frame_through():
    bench = ScanBench()
    bench.add("odrive", 3)
    bench.bus.inject(Dominant())
    assert bench.scan().verdict is Verdict.BLOCKED


def test_a_full_bus_is_said():
    bench = ScanBench(bitrate=500_000)
    for number in range(4):
        bench.add("vesc", number)
    report = bench.scan()
    assert report.verdict is Verdict.FULL
    assert report.found


def test_a_device_without_can_fd_is_said_and_the_rest_is_found():
    bench = ScanBench(data_bitrate=5_000_000)
    bench.plug(bench.add("odrive", 3, on=False), FdSupport.INTOLERANT)
    report = bench.scan()
    assert report.verdict is Verdict.CLASSIC
    assert numbers(report) == {("ODrive", 3)}


def test_frames_of_an_unknown_protocol_are_named():
    bench = ScanBench()
    stranger = bench.bus.attach("stranger", lambda _: None)
    for beat in range(10):
        bench.bus.schedule(
            (700 + 50 * beat) * MS, lambda: stranger.send(0x8000_0000 | 0x18FEF100, bytes(8))
        )
    report = bench.scan()
    assert report.verdict is Verdict.UNKNOWN
    assert "0x18FEF100" in report.text


# Tables for the robot's file --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "devices"),
    [
        ("odrive", [("odrive", 33, {}), ("odrive", 34, {})]),
        ("moteus", [("moteus", 1, {}), ("moteus", 2, {})]),
        ("zlac8015d", [("cia402", 10, {"dialect": "zlac8015d"})]),
    ],
)
def test_the_suggested_tables_make_a_robot(robot, devices, tmp_path):
    path = config_directory() / f"{robot}.toml"
    config = load_robot(path)
    bench = ScanBench(data_bitrate=config.buses[0].data_bitrate)
    for kind, number, keys in devices:
        bench.add(kind, number, **keys)
    tables = motor_tables(bench.scan().found, config.drive.wheel_names)
    text = path.read_text(encoding="utf-8")
    start = text.index("[[motor]]")
    rest = text[start:].split("\n\n")
    others = "\n\n".join(part for part in rest if "[[motor]]" not in part)
    file = tmp_path / "found.toml"
    file.write_text(f"{text[:start]}\n{tables}\n{others}", encoding="utf-8")
    found = load_robot(file)
    assert [motor.kind for motor in found.motors] == [kind for kind, _, _ in devices]
    assert [motor.node_ids[0] for motor in found.motors] == [number for _, number, _ in devices]
    assert tomllib.loads(tables)


def test_questions_to_odrives_have_no_data_and_ask_only():
    """Some controllers hand the data of an earlier frame on with a remote request."""
    (probe,) = (each for each in all_probes() if each.protocol == "CANSimple")
    for question in probe.questions(0):
        assert question.arbitration_id & REMOTE_FLAG
        assert not question.data
