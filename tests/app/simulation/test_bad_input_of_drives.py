"""Bad input of bought drives, with the control core in the loop.

Each ends in a stop with its true cause in words, which are the same on the terminal, by MAVLink and
in the log; nothing resumes by itself, although the velocity is commanded on and on.
"""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import pytest
from rich.console import Console

from firmware_sim.bus.frame import EXTENDED_FLAG, FD_FLAG
from robotctl.app.processes.robot import record_header
from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.app.simulation.run_status import RunStatus
from robotctl.cli.live.view import LineView
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.core.control_core import Outputs
from robotctl.messages.control import (
    Arm,
    EmergencyStop,
    EmergencyStopSource,
    Notice,
    SafetyState,
    VelocityCommand,
)
from robotctl.messages.faults import FaultCode as C
from robotctl.runtime.flight.recorder import Recorder, Tick, read_record
from robotctl.safety.state_machine import POWERED
from tests.mavlink.conftest import Bench, control_state
from tests.mavlink.services.link.test_ground_stations import heartbeat

MS: Final = 1_000_000
MIDDLE: Final = (3.0, 2.0, 0.0)
NAN: Final = struct.pack("<f", math.nan)
FLAGS: Final = EXTENDED_FLAG | FD_FLAG
MOTEUS, STATUS_BYTES = 0x100, 32
"""Identifier of all answers of moteus number 1, and the length of those to commands."""

Frames: TypeAlias = Sequence[tuple[int, bytes]]


class Bent:
    """Port of a twin that changes what it sends."""

    def __init__(self, port: Any, bend: Callable[[int, bytes], Frames]) -> None:
        self._port, self._bend = port, bend

    def send(self, arbitration_id: int, data: bytes) -> None:
        for each in self._bend(arbitration_id, data):
            self._port.send(*each)


class Robot:
    """A robot in the empty room, recorded; its first drive is the one that misbehaves."""

    def __init__(self, name: str, overrides: tuple[str, ...] = ()) -> None:
        robot = find_file(name)
        self.options = StackOptions(
            "bad", str(robot), overrides, x_m=MIDDLE[0], y_m=MIDDLE[1], theta_rad=MIDDLE[2]
        )
        world = find_file("empty_room", "worlds")
        self.simulation = make_simulation(robot, world, 1, MIDDLE, overrides)
        self.config = self.options.load()
        self.stack = LockstepStack(self.config, self.options, self.simulation)
        self.twin: Any = self.simulation.twins[0]
        self.notices: list[Notice] = []
        self.file = io.BytesIO()
        self._recorder = Recorder(self.file.write, record_header(self.config, self.options))

    @property
    def state(self) -> SafetyState:
        return self.stack.snapshot().state

    @property
    def now_ns(self) -> int:
        return self.stack.clock.now_ns()

    def tick(self, *requests: Any) -> Outputs:
        outputs = self.stack.tick(requests)
        self.notices += outputs.notices
        self._recorder.record(self.now_ns, self.stack.control.inputs, outputs)
        return outputs

    def arm(self, limit_s: float = 8.0) -> bool:
        """Ask again and again to be armed; return whether the robot is."""
        for _ in range(round(limit_s * 1e9 / self.stack.period_ns)):
            ask = self.stack.ticks % 100 == 99
            self.tick(*(Arm(self.now_ns, self.stack.ticks, arm=True),) if ask else ())
            if self.state in POWERED:
                return True
        return False

    def drive(self, seconds: float, v_m_s: float = 0.4) -> bool:
        """Command a velocity, whatever the robot does; return whether any wheel had power."""
        powered = False
        for _ in range(round(seconds * 1e9 / self.stack.period_ns)):
            self.tick(VelocityCommand(self.now_ns, self.now_ns + 300 * MS, v_m_s, 0.3))
            powered |= self.simulation.plant.powered or self.state in POWERED
        return powered

    def bend(self, change: Callable[[int, bytes], Frames]) -> None:
        """Change what the drive sends from now on."""
        self.twin._port = Bent(self.twin._port, change)


Act: TypeAlias = Callable[[Robot], None]


def changed(number: int, change: Callable[[bytes], bytes]) -> Act:
    """Change the data of one of the drive's frames."""

    def bend(arbitration_id: int, data: bytes) -> Frames:
        is_it = arbitration_id & ~FLAGS & 0x1FFF_FFFF == number
        is_it &= number != MOTEUS or len(data) == STATUS_BYTES
        return ((arbitration_id, change(data) if is_it else data),)

    return lambda robot: robot.bend(bend)


def frozen(number: int, start: int, stop: int) -> Act:
    """Let some bytes of one of the drive's frames stay as they are: a counter."""
    kept: list[bytes] = []

    def freeze(data: bytes) -> bytes:
        kept.append(data[start:stop])
        return data[:start] + kept[0] + data[stop:]

    return changed(number, freeze)


def reset(robot: Robot) -> None:
    """Let the drive reboot."""
    robot.simulation.faults.inject(f"node_reset node={robot.twin.name}")


def reset_with_old_frames(robot: Robot) -> None:
    """Let the drive reboot, and frames of before come behind that: from a gateway's queue."""
    port, seen = robot.twin._port, []

    def listen(arbitration_id: int, data: bytes) -> Frames:
        seen.append((arbitration_id, data))
        return seen[-1:]

    robot.bend(listen)
    robot.drive(0.06)
    robot.twin._port = port
    bus = robot.simulation.bus_of(robot.twin.name)
    queue = bus.attach("queue", lambda _: None)
    reset(robot)
    for late_ms, (arbitration_id, data) in enumerate(seen[-25:], 20):
        bus.schedule(
            bus.now_ns + late_ms * MS, lambda each=(arbitration_id, data): queue.send(*each)
        )


def healing(code: int, *, lasts_ms: int = 30) -> Act:
    """Let the drive have a fault whose cause is soon over."""

    def act(robot: Robot) -> None:
        robot.twin.trip(code)
        robot.drive(lasts_ms * 1e-3)
        robot.twin.heal()

    return act


def cleared_by_another(robot: Robot) -> None:
    """Let a moteus have a fault, and tview clear it."""
    robot.twin.trip(35)
    robot.drive(0.03)
    robot.twin.command("d stop")


def nothing(_: Robot) -> None:
    """Let the drive be as it was from the start."""


def set_object(index: int, value: int, subindex: int = 0) -> Act:
    """Let another tool write an object of a drive of CiA 402."""
    return lambda robot: robot.twin.dictionary.set(index, subindex, value)


def longer_watchdog(robot: Robot) -> None:
    """Let odrivetool write the watchdog's time."""
    robot.twin.watchdog.timeout = struct.pack("<f", 1.0)


class Bad(NamedTuple):
    """One bad input: what it is, of which robot, the code and words of the stop, and settings."""

    kind: str
    robot: str
    act: Act
    code: C
    words: str
    settings: tuple[str, ...] = ()
    v_m_s: float = 0.4


def of_cia402(
    robot: str, fault: int, setting: Act, words: str, about: str, most_rad_s: float
) -> list[Bad]:
    """Return what befalls each dialect of CiA 402."""
    twin = "simulation.twin.motors"
    return [
        Bad("layout", robot, changed(0x18A, lambda data: data[:-2]), C.DRIVE_UNREADABLE, "TPDO1"),
        Bad("firmware", robot, nothing, C.NODE_OTHER_DEVICE, "401", (f"{twin}.profile=401",)),
        Bad("setting", robot, setting, C.NODE_CHANGED, about),
        Bad("reboot", robot, reset, C.NODE_RESTARTED, "motors (node 10) restarted"),
        Bad("old session", robot, reset_with_old_frames, C.NODE_RESTARTED, "motors (node 10)"),
        Bad("saturates", robot, nothing, C.WHEEL_ASTRAY, "does not follow",
            (f"{twin}.speed_max_rad_s={most_rad_s}",), 0.8),
        Bad("heals", robot, healing(fault), C.DRIVE_ENCODER if robot != "roboteq"
            else C.DRIVE_FAULT, words, (f"{twin}.heals=true",)),
    ]  # fmt: skip


BAD: Final = [
    # ODrive: left_drive is node 33, 0x420 and on.
    Bad("layout", "odrive", changed(0x429, lambda data: data[:4]), C.DRIVE_UNREADABLE,
        "encoder estimate is unreadable"),
    Bad("layout", "odrive", changed(0x421, lambda data: data[:5]), C.DRIVE_UNREADABLE,
        "heartbeat is unreadable"),
    Bad("firmware", "odrive", nothing, C.NODE_OTHER_FIRMWARE, "firmware 0.7.1",
        ("simulation.twin.left_drive.firmware=[0, 7, 1]",)),
    Bad("setting", "odrive", longer_watchdog, C.NODE_CHANGED,
        "watchdog_timeout reads back 1 s, wanted 0.09 s"),
    Bad("reboot", "odrive", reset, C.NODE_SILENT, "it restarted, or was cut off"),
    Bad("old session", "odrive", reset_with_old_frames, C.NODE_SILENT, "it restarted, or was cut"),
    Bad("nan", "odrive", changed(0x429, lambda data: NAN + data[4:]), C.DRIVE_UNREADABLE, "nan"),
    Bad("nan", "odrive", changed(0x429, lambda data: data[:4] + NAN), C.DRIVE_UNREADABLE, "nan"),
    Bad("stands", "odrive", frozen(0x429, 0, 4), C.ENCODER_STUCK, "position moved by 0.00 rad"),
    Bad("saturates", "odrive", nothing, C.WHEEL_ASTRAY, "does not follow",
        ("simulation.twin.left_drive.vel_limit=6",
         "simulation.twin.left_drive.vel_limit_tolerance=0"), 0.8),
    Bad("heals", "odrive", healing(0x400), C.DRIVE_OVER_CURRENT, "DC_BUS_OVER_CURRENT"),
    # VESC: number 10.
    Bad("layout", "vesc_car", changed(0x90A, lambda data: data[:6]), C.DRIVE_UNREADABLE,
        "status 1 has 6 bytes"),
    Bad("firmware", "vesc_car", nothing, C.NODE_OTHER_FIRMWARE, "firmware 7.00 is not known",
        ("simulation.twin.vesc.firmware=[7, 0]",)),
    Bad("setting", "vesc_car", lambda robot: robot.twin.configure(1000, 0.0), C.NODE_CHANGED,
        "time-out 1000 ms, then it coasts"),
    Bad("reboot", "vesc_car", reset, C.NODE_RESTARTED, "vesc (node 10) restarted"),
    Bad("old session", "vesc_car", reset_with_old_frames, C.NODE_RESTARTED, "vesc (node 10)"),
    Bad("stands", "vesc_car", frozen(0x1B0A, 0, 4), C.ENCODER_STUCK, "position moved by 0.00 rad"),
    Bad("saturates", "vesc_car", nothing, C.WHEEL_ASTRAY, "does not follow",
        ("simulation.twin.vesc.max_erpm=1500",), 0.8),
    Bad("heals", "vesc_car", healing(4), C.DRIVE_OVER_CURRENT, "fault 4: over current"),
    Bad("heals", "vesc_car", healing(4), C.DRIVE_OVER_CURRENT, "fault 4: over current",
        ("simulation.twin.vesc.fault_stop_ms=30",)),
    # moteus: number 1, which answers to the host, 0.
    Bad("layout", "moteus", changed(0x100, lambda data: b"\x29" + data[1:]), C.DRIVE_UNREADABLE,
        "is not to be understood"),
    Bad("layout", "moteus", changed(0x100, lambda data: data[:20]), C.DRIVE_UNREADABLE,
        "an answer of 20 bytes"),
    Bad("firmware", "moteus", nothing, C.NODE_OTHER_FIRMWARE, "register map 6",
        ("simulation.twin.moteus_left.register_map=6",)),
    Bad("setting", "moteus", lambda robot: robot.twin.command("conf set servo.timeout_mode 12"),
        C.NODE_CHANGED, "servo.timeout_mode reads 12, wanted 15"),
    Bad("reboot", "moteus", reset, C.NODE_RESTARTED, "moteus_left (node 1) restarted"),
    Bad("old session", "moteus", reset_with_old_frames, C.NODE_RESTARTED, "moteus_left (node 1)"),
    Bad("nan", "moteus", changed(0x100, lambda data: data[:5] + NAN + data[9:]),
        C.DRIVE_UNREADABLE, "its position is nan turns"),
    Bad("stands", "moteus", frozen(0x100, 27, 31), C.DRIVE_UNREADABLE, "millisecond counter"),
    Bad("stands", "moteus", frozen(0x100, 5, 9), C.ENCODER_STUCK, "position moved by 0.00 rad"),
    Bad("saturates", "moteus", nothing, C.WHEEL_ASTRAY, "does not follow",
        ("simulation.twin.moteus_left.max_velocity=10",), 0.8),
    Bad("heals", "moteus", cleared_by_another, C.DRIVE_ENCODER, "fault 35"),
    # CiA 402: node 10.
    *of_cia402("cia402", 0x7305, set_object(0x6007, 3), "incremental sensor 1 (0x7305)",
               "abort connection option reads back 3", 60.0),
    *of_cia402("zlac8015d", 0x0200, set_object(0x2000, 500), "Hall sensor", "reads back 500",
               3.0),
    *of_cia402("roboteq", 0x40, set_object(0x1017, 500), "MOSFET failure",
               "reads back 500", 60.0),
    Bad("firmware", "cia402", nothing, C.NODE_OTHER_FIRMWARE, "0x6085",
        ('simulation.twin.motors.lacks=["6085"]',)),
    Bad("stands", "cia402", frozen(0x28A, 0, 4), C.ENCODER_STUCK, "position moved by 0.00 rad"),
]  # fmt: skip
KINDS: Final = {
    "layout", "firmware", "setting", "reboot", "old session", "nan", "stands", "saturates", "heals",
}  # fmt: skip
INTEGERS_ONLY: Final = {"vesc_car", "cia402", "zlac8015d", "roboteq"}
"""Robots whose drives send no float: what is not a number cannot be said."""


def test_each_kind_of_drive_has_each_bad_input_that_its_protocol_can_carry() -> None:
    for robot in {bad.robot for bad in BAD} - {"zlac8015d", "roboteq"}:
        there = {bad.kind for bad in BAD if bad.robot == robot}
        assert there == KINDS - ({"nan"} if robot in INTEGERS_ONLY else set())


def bad_input_befalls(bad: Bad) -> Robot:
    """Return a robot that has stopped for a bad input, or that did not arm for it."""
    robot = Robot(bad.robot, bad.settings)
    if robot.arm():
        robot.drive(0.8, bad.v_m_s)
        bad.act(robot)
        for _ in range(50):
            robot.drive(0.05, bad.v_m_s)
            if robot.state not in POWERED:
                break
        robot.drive(0.8, bad.v_m_s)  # by then causes are known
    return robot


@pytest.mark.parametrize("bad", BAD, ids=lambda bad: f"{bad.robot}-{bad.kind}")
def test_it_ends_in_a_stop_with_its_cause_in_words_and_nothing_resumes(bad: Bad) -> None:
    robot = bad_input_befalls(bad)
    control = robot.stack.snapshot()
    assert control.state is (SafetyState.BOOT if bad.kind == "firmware" else SafetyState.FAULT)
    assert control.fault is bad.code, (control.fault, control.reason)
    assert bad.words in control.reason
    assert not robot.drive(1.5, bad.v_m_s)
    assert robot.stack.snapshot().reason == control.reason
    said = [notice for notice in robot.notices if bad.words in notice.text]
    assert said
    everywhere = [on_terminal(robot, said), by_mavlink(said), in_the_log(robot)]
    assert all(bad.words in text for text in everywhere), everywhere


def on_terminal(robot: Robot, said: Sequence[Notice]) -> str:
    """Return what a terminal shows of notices."""
    console = Console(file=io.StringIO(), width=80)
    lines = [notice.text for notice in said]
    LineView(console, robot.config, ()).update(RunStatus(lines=lines))
    text: str = console.file.getvalue()  # type: ignore[attr-defined]
    return text


def by_mavlink(said: Sequence[Notice]) -> str:
    """Return what a ground station reads of notices."""
    bench = Bench()
    bench.receive(heartbeat())
    bench.step(*said, control_state(bench.now_ns))
    bench.run(1.0)
    return "".join(bench.texts())


def in_the_log(robot: Robot) -> str:
    """Return the notices in the flight record."""
    robot.file.seek(0)
    ticks = [each for each in read_record(robot.file, "bad.rec")[1] if isinstance(each, Tick)]
    return "\n".join(notice.text for tick in ticks for notice in tick.outputs.notices)


LOST: Final = "frames_lost id=0x20a duration=30"
"""Commands to a drive of CiA 402 are lost, the host's heartbeat is not."""
OF_CIA402: Final = ("cia402", "zlac8015d", "roboteq")


def power_ends_ms(robot: Robot, v_m_s: float, limit_ms: float) -> float:
    """Command a velocity until no wheel has power; return how long that took [ms]."""
    began_ns = robot.now_ns
    while robot.simulation.plant.powered and robot.now_ns - began_ns < limit_ms * MS:
        robot.drive(0.005, v_m_s)
    return (robot.now_ns - began_ns) / MS


@pytest.mark.parametrize("name", OF_CIA402)
def test_a_change_of_speed_that_does_not_reach_a_drive_stops_the_robot(name: str) -> None:
    robot = Robot(name)
    assert robot.arm()
    robot.drive(0.8)
    robot.simulation.faults.inject(LOST)
    robot.drive(0.5)
    assert robot.state in POWERED, "it does what is commanded"
    assert power_ends_ms(robot, 0.2, 1000.0) <= 500.0
    control = robot.stack.snapshot()
    assert control.fault is C.COMMAND_LOSS
    assert "commands do not reach it" in control.reason
    assert not robot.drive(1.5, 0.2)


@pytest.mark.parametrize("name", OF_CIA402)
def test_an_emergency_stop_reaches_a_drive_whose_commands_are_lost(name: str) -> None:
    robot = Robot(name)
    assert robot.arm()
    robot.drive(0.8)
    robot.simulation.faults.inject(LOST)
    robot.drive(0.3)
    robot.tick(EmergencyStop(robot.now_ns, EmergencyStopSource.OPERATOR))
    assert power_ends_ms(robot, 0.4, 1000.0) <= 120.0
    assert robot.stack.snapshot().fault is C.EMERGENCY_STOP
    assert not robot.drive(2.0)
