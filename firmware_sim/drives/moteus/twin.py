"""One moteus: modes, watchdog, faults, registers, and its diagnostic stream.

Sources: docs/protocol/can.md, docs/protocol/registers.md, docs/protocol/diagnostic.md,
docs/reference/configuration.md and docs/troubleshooting/timeout-mode-11.md of mjbots/moteus. Of
position mode only velocity (position nan) is simulated, which wheels need.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from firmware_sim.bus.frame import (
    BIT_RATE_SWITCH_FLAG,
    ERROR_STATE_FLAG,
    EXTENDED_FLAG,
    FD_FLAG,
    FD_LENGTHS,
)
from firmware_sim.drives.moteus import registers
from firmware_sim.drives.moteus.registers import Read, StreamPoll, StreamWrite, Write
from firmware_sim.drives.moteus.settings import MoteusSettings
from firmware_sim.drives.twin import NEVER_NS, CanFrame, Motor, Twin, stored
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage
from firmware_sim.plant.axis import Limits, Mode

MS: Final = 1_000_000
STOPPED, FAULT, ENABLING, POSITION, TIMEOUT, ZERO_VELOCITY, BRAKE = 0, 1, 2, 10, 11, 12, 15

OVER_VOLTAGE, OVER_TEMPERATURE, UNDER_VOLTAGE = 34, 38, 40
"""Fault codes that the twin detects itself; `trip` takes any other."""
LEAST_V: Final = 8.0
GUARD_NS: Final = 10 * MS
"""Period of the checks of supply and temperature [ns]."""

_CHANNEL: Final = 1
_TIMEOUT_MODE: Final = (1, 0)
"""Key of its stored value."""
_KEY: Final = "servo.timeout_mode"
_BOARD_C: Final = 30.0
_COMMANDED: Final = (POSITION, ZERO_VELOCITY)
"""Modes that can be commanded, and that have a watchdog."""
REPLIES: Final = 0x80
"""Flag of a sender that wants an answer."""


class Target(NamedTuple):
    """Commanded mode, velocity [turn/s], time-out [s] (0: the default)."""

    mode: int
    velocity: float = 0.0
    watchdog_s: float = 0.0


class MoteusTwin(Twin):
    """The drive.

    Parameters
    ----------
    name, number
        Name in the robot's file, and id on the bus.
    settings
        True properties.
    motor, ratio
        Its motor, and motor turns per wheel turn.
    stage
        Power stage.
    run_to
        As for `Twin`.
    store
        Its flash memory.

    Attributes
    ----------
    mode, fault
        Registers 0x000 and 0x00F.
    timeout_mode
        `servo.timeout_mode` in force.
    """

    def __init__(
        self,
        name: str,
        number: int,
        settings: MoteusSettings,
        motor: Motor,
        ratio: float,
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> None:
        super().__init__(name, run_to)
        self._number = number
        self._settings = settings
        self._motor = motor
        self._stage = stage
        self._store = store
        motor.axis.limits = Limits(
            current_a=settings.max_current_a,
            acceleration_rad_s2=settings.acceleration_turns_s2 * math.tau / ratio,
        )
        for source in range(256):
            plain = source << 8 | number
            handler = self._from(source)
            self._handlers[FD_FLAG | EXTENDED_FLAG | plain] = handler
            if plain <= 0x7FF:
                self._handlers[FD_FLAG | plain] = handler
        self.mode, self.fault = STOPPED, 0
        self._registers: dict[int, Callable[[], float]] = {
            0x000: lambda: self.mode,
            0x001: lambda: self._motor.turns - self._turns_at_boot,
            0x002: lambda: self._motor.speed_rad_s / math.tau,
            0x003: lambda: 0.0,
            0x004: lambda: self._motor.current_a,
            0x005: lambda: 0.0,
            0x00D: lambda: self._stage.bus_voltage_v,
            0x00E: lambda: _BOARD_C,
            0x00F: lambda: self.fault,
            0x027: lambda: self._target.watchdog_s,
            0x070: lambda: (self._now_ns - self._boot_ns) // MS,
            0x101: lambda: settings.firmware,
            0x102: lambda: settings.register_map,
            0x110: lambda: self._number,
            0x120: lambda: settings.serial[0],
            0x121: lambda: settings.serial[1],
            0x122: lambda: settings.serial[2],
        }
        self._on_power_up(0)

    def _on_power_up(self, now_ns: int) -> None:
        flash = stored(self._store)
        self.timeout_mode = flash.get(_TIMEOUT_MODE, self._settings.timeout_mode)
        self.mode, self.fault = STOPPED, 0
        self._target = Target(STOPPED)
        self._boot_ns = now_ns
        self._awake_ns = now_ns + self._settings.boot_ms * MS
        self._guard_ns = self._awake_ns
        self._ready_ns = self._watchdog_ns = NEVER_NS
        self._turns_at_boot = self._motor.turns
        self._typed = b""
        self._said = b""
        self._act()

    # Faults from outside ------------------------------------------------------------------------

    def trip(self, code: int) -> None:
        """Raise a fault: no torque until a stop."""
        self.mode, self.fault = FAULT, code
        self._act()
        self._reschedule()

    # Time ---------------------------------------------------------------------------------------

    def _due_ns(self) -> int:
        return min(self._guard_ns, self._ready_ns, self._watchdog_ns)

    def _step(self, now_ns: int) -> None:
        self._run_to(now_ns)
        if now_ns >= self._ready_ns:
            self._ready_ns = NEVER_NS
            if self.mode == ENABLING:
                self.mode = self._target.mode
                self._act()
        if now_ns >= self._watchdog_ns:
            self._watchdog_ns = NEVER_NS
            if self.mode in _COMMANDED or self.mode == ENABLING:
                self.mode = TIMEOUT
                self._act()
        if now_ns >= self._guard_ns:
            self._guard_ns = now_ns + GUARD_NS
            self._guard()

    def _guard(self) -> None:
        """Check supply and temperature while there is torque."""
        if self.mode in (STOPPED, FAULT):
            return
        settings, supply_v = self._settings, self._stage.bus_voltage_v
        if supply_v > settings.max_voltage_v:
            self.trip(OVER_VOLTAGE)
        elif supply_v < LEAST_V:
            self.trip(UNDER_VOLTAGE)
        elif self._motor.axis.temperature_c > settings.fault_temperature_c:
            self.trip(OVER_TEMPERATURE)

    def _act(self) -> None:
        """Command the motor according to the mode."""
        mode = self.timeout_mode if self.mode == TIMEOUT else self.mode
        if mode == BRAKE:
            self._motor.command(Mode.SHORTED)
        elif self.mode == TIMEOUT and mode != STOPPED:
            self._motor.command(Mode.SPEED, 0.0)
        elif mode in _COMMANDED:
            most = self._settings.max_velocity
            velocity = self._target.velocity if mode == POSITION else 0.0
            self._motor.command(Mode.SPEED, min(max(velocity, -most), most) * math.tau)
        else:
            self._motor.command(Mode.COAST)

    # Frames -------------------------------------------------------------------------------------

    def on_frame(self, frame: CanFrame) -> None:
        """Take one frame, whether with bit-rate switch or without."""
        plain = frame.arbitration_id & ~(BIT_RATE_SWITCH_FLAG | ERROR_STATE_FLAG)
        handler = self._handlers.get(plain)
        if handler is not None and frame.stamp_ns >= self._awake_ns:
            self._now_ns = frame.stamp_ns
            handler(frame.data, frame.stamp_ns)
            self._reschedule()

    def _from(self, source: int) -> Callable[[bytes, int], None]:
        """Return the handler of frames of one sender."""

        def handle(data: bytes, now_ns: int) -> None:
            self._run_to(now_ns)
            asked = list(registers.subframes(data))
            reads = [each for each in asked if isinstance(each, Read)]
            before = b"" if self._settings.answers_after else self._answer(reads)
            written = {each.register: each.value for each in asked if isinstance(each, Write)}
            if written:
                self._on_write(written, now_ns)
            said = before or self._answer(reads)
            for each in asked:
                if isinstance(each, StreamWrite) and each.channel == _CHANNEL:
                    self._on_typed(each.data)
                elif isinstance(each, StreamPoll) and each.channel == _CHANNEL:
                    said += self._on_poll(each.most)
            if source & REPLIES:
                self._reply(source & 0x7F, said)

        return handle

    def _answer(self, reads: list[Read]) -> bytes:
        return b"".join(registers.answer(read, self._value) for read in reads)

    def _value(self, register: int) -> float | None:
        found = self._registers.get(register)
        return None if found is None else found()

    def _reply(self, destination: int, data: bytes) -> None:
        """Send an answer in a frame of the next valid length."""
        length = next(each for each in FD_LENGTHS if each >= len(data))
        plain = self._number << 8 | destination
        extended = EXTENDED_FLAG if plain > 0x7FF else 0
        padding = bytes((registers.NOP,)) * (length - len(data))
        self.send(FD_FLAG | BIT_RATE_SWITCH_FLAG | extended | plain, data + padding)

    def _on_write(self, written: dict[int, float], now_ns: int) -> None:
        """Take a command: the mode first, then the other registers."""
        if 0x000 not in written:
            return
        mode = int(written[0x000])
        velocity = written.get(0x021, 0.0)
        self._target = Target(
            mode, 0.0 if math.isnan(velocity) else velocity, written.get(0x027, 0.0)
        )
        if mode == STOPPED:
            self.mode, self.fault = STOPPED, 0
            self._ready_ns = self._watchdog_ns = NEVER_NS
        elif self.mode in (FAULT, TIMEOUT):
            return  # only a stop leaves these
        elif mode == BRAKE:
            self.mode = BRAKE
            self._ready_ns = self._watchdog_ns = NEVER_NS
        elif mode in _COMMANDED:
            self._begin(mode, now_ns)
        self._act()

    def _begin(self, mode: int, now_ns: int) -> None:
        """Start to operate, by way of the preparing modes if the bridge was off."""
        if self.mode == STOPPED:
            self.mode = ENABLING
            self._ready_ns = now_ns + self._settings.preparing_ms * MS
        elif self.mode != ENABLING:
            self.mode = mode
        timeout_s = self._target.watchdog_s or self._settings.default_timeout_s
        self._watchdog_ns = (
            NEVER_NS if math.isnan(timeout_s) else now_ns + round(timeout_s * 1_000_000_000)
        )

    # Diagnostic stream --------------------------------------------------------------------------

    def _on_typed(self, data: bytes) -> None:
        """Take typed text; each line is a command."""
        *lines, self._typed = (self._typed + data).replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            if line:
                self._said += self.command(line.decode("ascii", "replace")).encode() + b"\r\n"

    def _on_poll(self, most: int) -> bytes:
        """Return the subframe with the next output of the stream."""
        said, self._said = self._said[:most], self._said[most:]
        return bytes((registers.STREAM_ANSWER, _CHANNEL, len(said))) + said

    def command(self, line: str) -> str:
        """Carry out a line of the diagnostic protocol; return its answer."""
        match line.split():
            case ["conf", "get", key] if key == _KEY:
                return str(self.timeout_mode)
            case ["conf", "get", "servo.default_timeout_s"]:
                return f"{self._settings.default_timeout_s:f}"
            case ["conf", "set", key, value] if key == _KEY and value in ("0", "10", "12", "15"):
                self.timeout_mode = int(value)
                return "OK"
            case ["conf", "write"]:
                self._store.save({_TIMEOUT_MODE: self.timeout_mode})
                return "OK"
            case ["d", "stop"]:
                self._on_write({0x000: STOPPED}, self._now_ns)
                return "OK"
        return "ERR unknown command"
