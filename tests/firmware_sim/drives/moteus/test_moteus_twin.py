"""The twin of a moteus alone, driven by its maker's own package as the host."""

from __future__ import annotations

import asyncio
import math
from types import SimpleNamespace

import moteus
import pytest
from moteus import multiplex
from moteus.protocol import Register

from firmware_sim.bus.frame import BIT_RATE_SWITCH_FLAG, EXTENDED_FLAG, FD_FLAG, FD_LENGTHS
from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.moteus.config import MoteusMotor
from firmware_sim.drives.moteus.registers import Read, Write, answer, subframes
from firmware_sim.drives.moteus.settings import MoteusSettings
from firmware_sim.plant.axis import Mode
from tests.drivers.can.drives.bench import MS, Bench

RATIO = 20.0
ALL = {
    Register.MODE: multiplex.INT8,
    Register.POSITION: multiplex.F32,
    Register.VELOCITY: multiplex.F32,
    Register.Q_CURRENT: multiplex.INT32,
    Register.VOLTAGE: multiplex.INT16,
    Register.TEMPERATURE: multiplex.INT8,
    Register.FAULT: multiplex.INT8,
    Register.MILLISECOND_COUNTER: multiplex.INT32,
}


class Line:
    """A twin on a bus, and the maker's package with a transport onto it."""

    def __init__(self, number: int = 1, **settings: object) -> None:
        table = MoteusMotor("moteus", "m", (AxisSection("left", ratio=RATIO),), node_id=number)
        twin = MoteusSettings(**{"max_current_a": 10.0, **settings})  # type: ignore[arg-type]
        self.bench = Bench((None, table, twin), host=False, data_bitrate=5_000_000)
        self.twin = self.bench.twin
        self.axis = self.bench.plant.axes[0]
        self.peer = moteus.Controller(number, transport=self)
        self.run(200)

    def run(self, ms: float) -> None:
        self.bench.advance(round(ms * MS))

    def exchange(self, command: moteus.Command, ms: float = 1.0) -> list:
        """Send a command of the package, as its transport does, and return the answers."""
        plain = (command.source | 0x80 * command.reply_required) << 8 | command.destination
        extended = EXTENDED_FLAG if plain > 0x7FF else 0
        length = next(each for each in FD_LENGTHS if each >= len(command.data))
        self.bench.received.clear()
        data = command.data + b"\x50" * (length - len(command.data))
        self.bench.send(FD_FLAG | extended | plain, data)
        self.run(ms)
        frames = [
            SimpleNamespace(arbitration_id=identifier & 0x1FFFFFFF, data=found)
            for identifier, found, _ in self.bench.received
        ]
        assert len(frames) == command.reply_required
        return [command.parse(frame) for frame in frames]

    async def cycle(self, commands: list) -> list:
        return [found for command in commands for found in self.exchange(command)]

    async def read(self) -> None:
        await asyncio.sleep(3600)

    def query(self) -> dict:
        (found,) = self.exchange(self.peer.make_custom_query(ALL))
        return found.values

    def velocity(self, turns_s: float, watchdog_s: float | None = 1.0) -> None:
        self.exchange(
            self.peer.make_position(
                position=math.nan, velocity=turns_s, watchdog_timeout=watchdog_s, query=True
            )
        )

    def type(self, text: str) -> str:
        stream = moteus.Stream(self.peer, use_flow_control=False)
        found = asyncio.run(stream.command(text.encode(), allow_any_response=True))
        return found.decode()


@pytest.fixture
def line() -> Line:
    return Line()


@pytest.mark.parametrize("number", [1, 7, 8, 126])
def test_the_package_reads_its_registers(number: int) -> None:
    line = Line(number)
    values = line.query()
    assert values[Register.MODE] == 0
    assert values[Register.FAULT] == 0
    assert values[Register.VOLTAGE] == pytest.approx(line.bench.plant.bus_voltage_v, abs=0.06)
    assert values[Register.MILLISECOND_COUNTER] == pytest.approx(200, abs=2)
    identifier = line.bench.received[0][0]
    assert identifier & 0x1FFFFFFF == number << 8
    assert bool(identifier & EXTENDED_FLAG) == (number > 7)


def test_every_resolution_tells_the_same(line: Line) -> None:
    line.velocity(3.0, 10.0)
    line.run(1000)
    for kind, within in ((0, 0.06), (1, 0.0005), (2, 0.0001), (3, 1e-6)):
        (found,) = line.exchange(line.peer.make_custom_query({Register.VELOCITY: kind}))
        true = line.axis.speed_rad_s * RATIO / math.tau
        assert found.values[Register.VELOCITY] == pytest.approx(true, abs=within + 0.01)


def test_position_mode_with_a_velocity_runs_after_it_has_prepared() -> None:
    line = Line(preparing_ms=20)
    line.velocity(5.0)
    assert line.query()[Register.MODE] == 2
    assert line.axis.mode is Mode.COAST
    line.run(20)
    assert line.query()[Register.MODE] == 10
    assert line.axis.mode is Mode.SPEED
    assert line.axis.value == pytest.approx(5.0 * math.tau / RATIO)
    before = line.query()[Register.POSITION]
    line.velocity(5.0, 10.0)
    line.run(1000)
    assert line.query()[Register.POSITION] - before == pytest.approx(5.0, abs=0.6)


@pytest.mark.parametrize(
    ("timeout_mode", "mode"),
    [(0, Mode.COAST), (10, Mode.SPEED), (12, Mode.SPEED), (15, Mode.SHORTED)],
)
@pytest.mark.parametrize(("watchdog_s", "ms"), [(0.05, 50), (0.5, 500), (0.0, 100), (None, 100)])
def test_the_watchdog_takes_it_into_the_time_out_mode_which_only_a_stop_leaves(
    timeout_mode: int, mode: Mode, watchdog_s: float | None, ms: int
) -> None:
    line = Line(timeout_mode=timeout_mode)
    line.velocity(5.0, watchdog_s)
    line.run(ms - 3)
    assert line.twin.mode == 10
    line.run(4)
    assert line.twin.mode == 11
    assert line.axis.mode is mode
    assert line.axis.value == 0.0
    line.velocity(5.0)
    line.run(20)
    assert line.query()[Register.MODE] == 11
    line.exchange(line.peer.make_stop())
    assert line.query()[Register.MODE] == 0
    line.velocity(5.0)
    line.run(20)
    assert line.query()[Register.MODE] == 10


def test_a_watchdog_that_is_no_number_never_comes(line: Line) -> None:
    line.velocity(5.0, math.nan)
    line.run(5000)
    assert line.twin.mode == 10


def test_queries_do_not_feed_the_watchdog(line: Line) -> None:
    line.velocity(5.0, 0.1)
    for _ in range(10):
        line.run(15)
        line.query()
    assert line.twin.mode == 11


def test_brake_and_stop(line: Line) -> None:
    line.velocity(5.0)
    line.run(20)
    line.exchange(line.peer.make_brake())
    assert (line.twin.mode, line.axis.mode) == (15, Mode.SHORTED)
    line.run(2000)
    assert line.twin.mode == 15, "it has no watchdog"
    line.exchange(line.peer.make_stop())
    assert (line.twin.mode, line.axis.mode) == (0, Mode.COAST)


@pytest.mark.parametrize("code", [32, 38, 48])
def test_a_fault_takes_all_torque_until_a_stop(line: Line, code: int) -> None:
    line.velocity(5.0)
    line.run(20)
    line.twin.trip(code)
    values = line.query()
    assert (values[Register.MODE], values[Register.FAULT]) == (1, code)
    line.velocity(5.0)
    line.exchange(line.peer.make_brake())
    assert line.axis.mode is Mode.COAST
    line.exchange(line.peer.make_stop())
    values = line.query()
    assert (values[Register.MODE], values[Register.FAULT]) == (0, 0)


@pytest.mark.parametrize(("volts", "code"), [(50.0, 34), (5.0, 40)])
def test_a_supply_out_of_range_is_a_fault(line: Line, volts: float, code: int) -> None:
    line.velocity(1.0)
    line.run(20)
    line.bench.plant._b["bus_v"] = volts
    line.twin._guard()
    assert line.twin.fault == code


@pytest.mark.parametrize("after", [False, True])
def test_an_answer_tells_of_before_or_after_its_command(after: bool) -> None:
    line = Line(answers_after=after)
    line.velocity(5.0)
    line.run(20)
    (found,) = line.exchange(line.peer.make_stop(query=True))
    assert found.values[Register.MODE] == (0 if after else 10)


def test_without_the_reply_bit_nothing_is_answered(line: Line) -> None:
    line.exchange(line.peer.make_stop())
    assert line.bench.received == []


def test_an_unknown_register_is_an_error(line: Line) -> None:
    frame = answer(Read(0, 0x7E, 1), line.twin._value)
    assert frame[:2] == bytes((multiplex.READ_ERROR, 0x7E))


def test_the_packages_stream_reads_and_sets_the_configuration(line: Line) -> None:
    assert line.type("conf get servo.timeout_mode") == "12"
    assert line.type("conf set servo.timeout_mode 15") == "OK"
    assert line.type("conf get servo.timeout_mode") == "15"
    assert float(line.type("conf get servo.default_timeout_s")) == pytest.approx(0.1)
    assert line.type("conf set servo.timeout_mode 13").startswith("ERR")
    assert line.type("nonsense").startswith("ERR")


@pytest.mark.parametrize("written", [False, True])
def test_a_setting_is_kept_over_a_power_cycle_only_if_it_was_written(
    line: Line, written: bool
) -> None:
    line.type("conf set servo.timeout_mode 0")
    if written:
        assert line.type("conf write") == "OK"
    line.twin.reboot(line.bench.now_ns)
    line.run(200)
    assert line.type("conf get servo.timeout_mode") == ("0" if written else "12")
    assert line.query()[Register.MILLISECOND_COUNTER] < 300


def test_nothing_is_obeyed_or_answered_while_it_boots() -> None:
    line = Line(boot_ms=1000)
    command = line.peer.make_stop()
    command.reply_required = False
    line.exchange(command)
    line.bench.send(FD_FLAG | EXTENDED_FLAG | 0x8001, line.peer.make_query().data)
    line.run(5)
    assert line.bench.received == []


def test_a_frame_without_bit_rate_switch_is_obeyed_too(line: Line) -> None:
    command = line.peer.make_brake()
    line.bench._port.send(FD_FLAG | 0x001, command.data)
    line.run(1)
    assert line.twin.mode == 15
    assert BIT_RATE_SWITCH_FLAG


def test_the_documents_example_is_understood() -> None:
    # docs/protocol/can.md, "Example".
    found = list(subframes(bytes.fromhex("01000a07206000200150ff140400130d")))
    assert found[0] == Write(0, 10)
    assert [each.register for each in found[1:4]] == [0x20, 0x21, 0x22]
    assert found[1].value * 360 == pytest.approx(3.456)
    assert found[2].value * 360 == pytest.approx(25.92)
    assert found[4:] == [Read(1, 0, 4), Read(0, 0x0D, 3)]
