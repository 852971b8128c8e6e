"""The twin of a VESC alone: what its documents and firmware say, frame by frame."""

from __future__ import annotations

import struct

import pytest

from firmware_sim.bus.frame import EXTENDED_FLAG
from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.vesc.config import VescMotor, VescSettings
from firmware_sim.plant.axis import Mode
from tests.drivers.can.drives.bench import MS, Bench

NUMBER, HOST = 23, 200


class Line:
    """A VESC on a bus, and frames written by hand."""

    def __init__(self, **settings: object) -> None:
        rate_hz = settings.pop("status_rate_hz", 200)
        axes = (AxisSection("left", ratio=20.0),)
        table = VescMotor("vesc", "motor", axes, node_id=NUMBER, status_rate_hz=rate_hz)  # type: ignore[arg-type]
        twin = VescSettings(**{"current_a": 10.0, **settings})  # type: ignore[arg-type]
        self.bench = Bench((None, table, twin), host=False)
        self.twin = self.bench.twin
        self.axis = self.bench.plant.axes[0]
        self.run(200)

    def run(self, ms: float) -> None:
        self.bench.advance(round(ms * MS))

    def send(self, command: int, data: bytes, number: int = NUMBER, ms: float = 1.0) -> None:
        self.bench.send(EXTENDED_FLAG | command << 8 | number, data)
        self.run(ms)

    def value(self, command: int, value: int, number: int = NUMBER) -> None:
        self.send(command, struct.pack(">i", value), number)

    def heard(self, command: int, number: int = NUMBER) -> list[bytes]:
        wanted = EXTENDED_FLAG | command << 8 | number
        return [data for identifier, data, _ in self.bench.received if identifier == wanted]

    def keep(self, command: int, value: int, ms: int) -> None:
        for _ in range(ms // 20):
            self.value(command, value)
            self.run(19)


def test_it_says_that_it_has_booted_and_then_sends_its_status() -> None:
    line = Line(status_rate_hz=100)
    assert line.heard(57) == [bytes((NUMBER,))]
    for command in (9, 14, 15, 16, 27, 58):
        assert len(line.heard(command)) == 5
        assert len(line.heard(command)[0]) == 8


def test_nothing_is_sent_or_obeyed_while_it_boots() -> None:
    line = Line(boot_ms=1000)
    line.value(3, 2000)
    assert line.bench.received == []
    assert line.axis.mode is Mode.COAST


@pytest.mark.parametrize(
    ("command", "value", "mode", "wanted"),
    [
        (0, 50_000, Mode.DUTY, 0.5),
        (1, 5_000, Mode.CURRENT, 5.0),
        (1, 10, Mode.COAST, 0.0),
        (2, 7_000, Mode.BRAKE_CURRENT, 7.0),
        (2, 0, Mode.COAST, 0.0),
        (12, 4_000, Mode.HOLD, 4.0),
        (3, 1337, Mode.SPEED, 1337 / 7 / 20 * 0.10471975511965977),
    ],
)
@pytest.mark.parametrize("number", [NUMBER, 255])
def test_simple_commands(command: int, value: int, mode: Mode, wanted: float, number: int) -> None:
    line = Line()
    line.value(command, value, number)
    assert line.axis.mode is mode
    assert line.axis.value == pytest.approx(wanted)


def test_commands_for_another_vesc_are_not_its_own() -> None:
    line = Line()
    line.value(3, 1000, 24)
    assert line.axis.mode is Mode.COAST


def test_status_tells_what_the_motor_does() -> None:
    line = Line(status_rate_hz=200)
    start = line.axis.angle_rad
    line.keep(3, 4000, 2000)
    erpm, current, duty = struct.unpack(">ihh", line.heard(9)[-1])
    assert erpm == pytest.approx(4000, rel=0.02)
    assert current / 10 == pytest.approx(line.axis.current_a, abs=0.2)
    assert duty > 0
    tachometer, volts, _ = struct.unpack(">ihh", line.heard(27)[-1])
    turns = (line.axis.angle_rad - start) / 6.283185307179586 * 20
    assert tachometer / 6 / 7 == pytest.approx(turns, rel=0.02)
    assert volts / 10 == pytest.approx(line.bench.plant.bus_voltage_v, abs=0.1)
    line.keep(3, -4000, 2000)
    assert struct.unpack(">ihh", line.heard(9)[-1])[0] == pytest.approx(-4000, rel=0.02)


@pytest.mark.parametrize("timeout_ms", [80, 500, 1000])
@pytest.mark.parametrize(("brake", "mode"), [(0.0, Mode.COAST), (6.0, Mode.BRAKE_CURRENT)])
def test_the_time_out_takes_the_power_within_ten_more_milliseconds(
    timeout_ms: int, brake: float, mode: Mode
) -> None:
    line = Line(stored_timeout_ms=timeout_ms, stored_brake_current_a=brake)
    line.value(3, 3000)
    line.run(timeout_ms - 2)
    assert line.axis.mode is Mode.SPEED
    line.run(12)
    assert line.axis.mode is mode
    line.value(3, 3000)
    assert line.axis.mode is Mode.SPEED, "it is not latched"


def test_a_time_out_of_0_never_comes() -> None:
    line = Line(stored_timeout_ms=0)
    line.value(3, 3000)
    line.run(5000)
    assert line.axis.mode is Mode.SPEED


def test_ping_and_packets_do_not_keep_the_motor_running() -> None:
    line = Line(stored_timeout_ms=100)
    line.value(3, 3000)
    for _ in range(6):
        line.send(17, bytes((HOST,)), ms=10)
        line.send(8, bytes((HOST, 0, 0)), ms=10)
    assert line.axis.mode is Mode.COAST
    assert line.heard(18, HOST)[0] == bytes((NUMBER, 0))


def test_a_fault_takes_the_power_for_a_while_and_is_then_forgotten() -> None:
    line = Line(fault_stop_ms=500)
    line.value(3, 3000)
    line.twin.trip(4)
    query = bytes((HOST, 0, 50)) + struct.pack(">I", 1 << 15)
    line.keep(3, 3000, 400)
    assert line.axis.mode is Mode.COAST
    line.send(8, query)
    assert line.heard(8, HOST)[-1] == bytes((NUMBER, 1)) + query[2:] + b"\x04"
    line.keep(3, 3000, 200)
    assert line.axis.mode is Mode.SPEED
    line.send(8, query)
    assert line.heard(8, HOST)[-1][-1] == 0


def test_an_empty_battery_trips_it() -> None:
    line = Line()
    line.bench.plant._b["rail_v"] = line.bench.plant._b["bus_v"] = 7.0
    line.twin._supervise(line.bench.now_ns)
    assert line.twin.fault == 2


def read_configuration(line: Line) -> bytes:
    line.bench.received.clear()
    line.send(8, bytes((HOST, 0, 17)), ms=40)
    content = b"".join(
        data[1:] if identifier >> 8 & 0xFF == 5 else data[2:]
        for identifier, data, _ in line.bench.received
        if identifier & 0xFF == HOST and identifier >> 8 & 0xFF in (5, 6)
    )
    length = struct.unpack_from(">H", line.heard(7, HOST)[-1], 2)[0]
    assert length == len(content)
    return content


def write_configuration(line: Line, packet: bytes) -> None:
    from crccheck.crc import CrcXmodem

    place = 0
    while place < len(packet):
        if place < 256:
            line.send(5, bytes((place,)) + packet[place : place + 7])
            place += 7
        else:
            line.send(6, struct.pack(">H", place) + packet[place : place + 6])
            place += 6
    end = struct.pack(">BBHH", HOST, 0, len(packet), CrcXmodem.calc(packet))
    line.send(7, end, ms=5)


@pytest.mark.parametrize(("command", "is_kept"), [(149, False), (16, True)])
def test_the_configuration_is_read_written_and_kept_or_not(command: int, is_kept: bool) -> None:
    line = Line()
    before = read_configuration(line)
    packet, _, number, timeout_ms, brake = struct.unpack_from(">BIBIf", before)
    assert (packet, number, timeout_ms, brake) == (17, NUMBER, 1000, 0.0)
    written = bytes((command,)) + before[1:6] + struct.pack(">If", 70, 3.5) + before[14:]
    write_configuration(line, written)
    assert line.heard(8, HOST)[-1] == bytes((NUMBER, 1, command))
    assert read_configuration(line)[1:] == written[1:]
    line.twin.reboot(line.bench.now_ns)
    line.run(200)
    assert struct.unpack_from(">If", read_configuration(line), 6) == (
        (70, 3.5) if is_kept else (1000, 0.0)
    )


def test_a_configuration_of_another_firmware_is_not_taken() -> None:
    line = Line()
    before = read_configuration(line)
    write_configuration(line, b"\x95" + bytes(4) + before[5:])
    assert line.heard(8, HOST) == []
    assert line.twin.timeout_ms == 1000


def test_a_firmware_without_the_command_does_not_answer_it() -> None:
    line = Line(sets_timeout=False)
    write_configuration(line, b"\x95" + read_configuration(line)[1:])
    assert line.heard(8, HOST) == []


def test_it_says_which_firmware_it_has() -> None:
    line = Line(firmware=(6, 2))
    line.send(8, bytes((HOST, 0, 0)), ms=10)
    assert line.heard(5, HOST)[0][1:4] == bytes((0, 6, 2))
