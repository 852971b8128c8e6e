"""One axis of an ODrive: its states, watchdog, errors and messages.

Sources: those of `wire.py`; for the watchdog of 0.5 odriverobotics/ODrive,
Firmware/MotorControl/axis.cpp, for that of 0.6 odriverobotics/ODriveResources,
examples/can_watchdog.py (Set_Axis_State and Set_Input_Vel feed it). Disarmed, the bridge is open,
so that the motor coasts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from firmware_sim.bus.frame import REMOTE_FLAG
from firmware_sim.drives.odrive import wire
from firmware_sim.drives.odrive.wire import Errors05, Errors06
from firmware_sim.drives.twin import NEVER_NS, Motor, Twin
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage
from firmware_sim.plant.axis import BrakeResistor, Limits, Mode

if TYPE_CHECKING:
    from firmware_sim.drives.odrive.config import ODriveSettings

_MS: Final = 1_000_000
_TURN: Final = 2.0 * math.pi
_FEEDS: Final = frozenset(
    {wire.SET_AXIS_STATE, wire.SET_INPUT_POS, wire.SET_INPUT_VEL, wire.SET_INPUT_TORQUE}
)
_COUNTS_PER_TURN: Final = 8192
"""Resolution of the encoder: a CUI AMT102 with its default switches."""


class ODriveTwin(Twin):
    """The twin: see `Twin`.

    Parameters
    ----------
    name
        Name of the drive.
    node_id
        Its number on the bus.
    settings
        The true drive.
    motor
        Motor on it.
    stage
        Supply.
    run_to
        As of `Twin`.
    store
        What `save_configuration` keeps: the watchdog.
    """

    def __init__(
        self,
        name: str,
        node_id: int,
        settings: ODriveSettings,
        motor: Motor,
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> None:
        super().__init__(name, run_to)
        self.node_id = node_id
        self._settings = settings
        self._motor = motor
        self._stage = stage
        self._store = store
        self._is_old = settings.firmware < (0, 6, 0)
        self._id = node_id << wire.NODE_SHIFT
        self._set_handlers()
        self._reset(NEVER_NS)

    def _reset(self, ready_ns: int) -> None:
        """Forget all but what is stored; messages begin at a time [ns]."""
        settings = self._settings
        self._ready_ns = ready_ns
        self._beat_ns = ready_ns if settings.heartbeat_ms else NEVER_NS
        self._encoder_ns = ready_ns if settings.encoder_ms else NEVER_NS
        self._armed_ns = NEVER_NS
        """When the requested closed-loop control begins [ns]."""
        self.state = wire.IDLE
        self._result = wire.SUCCESS
        self._mode, self._input_mode = wire.POSITION_CONTROL, wire.PASSTHROUGH
        self._input_vel = self._input_torque = 0.0
        self._vel_limit, self._current_a = settings.vel_limit, settings.current_limit_a
        self.axis_error = self.motor_error = self.encoder_error = self.controller_error = 0
        self.active_errors = self.disarm_reason = 0
        self._causes: list[tuple[int, str]] = []
        """Errors whose causes last, and their parts."""
        self._timeout, self._is_watched = self._stored()
        self._expires_ns = ready_ns + self._timeout_ns()

    def _stored(self) -> tuple[bytes, bool]:
        """Return the stored watchdog: the bytes of its time [s], and whether it is on."""
        stored = self._store.load()
        if (0, 0) in stored:
            return wire.UINT32.pack(stored[0, 0]), bool(stored[0, 1])
        watchdog_ms = self._settings.watchdog_ms
        return wire.FLOAT.pack(watchdog_ms / 1000.0), watchdog_ms > 0.0

    def _timeout_ns(self) -> int:
        seconds = wire.FLOAT.unpack(self._timeout)[0]
        return round(seconds * 1e9) if 0.0 <= seconds < 1e6 else 0

    # Power and time -----------------------------------------------------------------------------

    def _on_power_up(self, now_ns: int) -> None:
        settings = self._settings
        if settings.brake_resistor_ohm:
            resistor = BrakeResistor(settings.brake_resistor_ohm, settings.brake_resistor_from_v)
            self._stage.fit_brake_resistor(resistor)
        self._start(now_ns)

    def _start(self, now_ns: int) -> None:
        """Begin anew, bridge open."""
        self._run_to(now_ns)
        self._motor.command(Mode.COAST)
        self._reset(now_ns + round(self._settings.boot_ms * _MS))

    def reboot(self, now_ns: int) -> None:
        """Restart, as after a brown-out of its logic."""
        self._now_ns = now_ns
        self._start(now_ns)
        self._reschedule()

    def _due_ns(self) -> int:
        return min(self._beat_ns, self._encoder_ns, self._armed_ns, self._watchdog_due_ns())

    def _watchdog_due_ns(self) -> int:
        """Return when the watchdog expires, if it is on and has not [ns]."""
        always = self._is_old or self._settings.watchdog_while_idle
        if not self._is_watched or not (always or self.is_armed) or self._has_expired():
            return NEVER_NS
        return max(self._expires_ns, self._ready_ns)

    def _has_expired(self) -> bool:
        if self._is_old:
            return bool(self.axis_error & Errors05.AXIS_WATCHDOG)
        return bool(self.disarm_reason & Errors06.WATCHDOG)

    def _step(self, now_ns: int) -> None:
        if now_ns >= self._watchdog_due_ns():
            self._trip(Errors05.AXIS_WATCHDOG, Errors06.WATCHDOG)
        if now_ns >= self._armed_ns:
            self._armed_ns = NEVER_NS
            self._arm()
        self._check()
        if now_ns >= self._beat_ns:
            self._beat_ns += self._settings.heartbeat_ms * _MS
            self._send_heartbeat()
        if now_ns >= self._encoder_ns:
            self._encoder_ns += self._settings.encoder_ms * _MS
            self._send_estimates()

    # State --------------------------------------------------------------------------------------

    @property
    def is_armed(self) -> bool:
        """Whether the bridge is on."""
        return self.state == wire.CLOSED_LOOP

    @property
    def _has_errors(self) -> bool:
        parts = self.motor_error | self.encoder_error | self.controller_error
        return bool(self.axis_error | parts | self.active_errors | self.disarm_reason)

    def _check(self) -> None:
        """Look at supply and speed of an armed axis."""
        if not self.is_armed:
            return
        settings = self._settings
        self._run_to(self._now_ns)
        voltage_v = self._stage.bus_voltage_v
        if voltage_v > settings.overvoltage_v:
            self._trip_motor(Errors05.MOTOR_SYSTEM_LEVEL, Errors06.OVER_VOLTAGE)
        elif voltage_v < settings.undervoltage_v:
            self._trip_motor(Errors05.MOTOR_SYSTEM_LEVEL, Errors06.UNDER_VOLTAGE)
        limit = settings.vel_limit_tolerance * self._vel_limit * _TURN
        if limit and abs(self._motor.speed_rad_s) > limit:
            if self._is_old:
                self.controller_error |= Errors05.CONTROLLER_OVERSPEED
                self._disarm()
            else:
                self._trip(0, Errors06.VELOCITY_LIMIT)

    def _trip(self, old: int, new: int) -> None:
        """Disarm with an error of the axis: its bit in 0.5 and in 0.6."""
        if self._is_old:
            self.axis_error |= old
        else:
            self.disarm_reason |= new
        self._disarm()

    def _trip_motor(self, old: int, new: int) -> None:
        """Disarm with an error that 0.5 counts to the motor."""
        if self._is_old:
            self.motor_error |= old
            self._disarm()
        else:
            self._trip(0, new)

    def trip(self, code: int, part: str = "axis", *, lasts: bool = False) -> None:
        """Have an error from outside.

        Parameters
        ----------
        code
            Bits of Active_Errors with firmware 0.6; with 0.5 those of the part.
        part
            With firmware 0.5 "axis", "motor", "encoder" or "controller".
        lasts
            Whether its cause stays until `heal`.
        """
        if lasts:
            self._causes.append((code, part))
        if self._is_old:
            name = f"{part}_error"
            setattr(self, name, getattr(self, name) | code)
        else:
            self.disarm_reason |= code
            self.active_errors |= code if lasts else 0
        self._disarm()

    def heal(self) -> None:
        """Lose all errors and their causes by itself: what no ODrive is documented to do."""
        self._causes.clear()
        self._clear()

    def _clear(self) -> None:
        """Forget the errors whose causes are gone."""
        self.axis_error = self.motor_error = self.encoder_error = self.controller_error = 0
        self.active_errors = self.disarm_reason = 0
        causes, self._causes = self._causes, []
        for code, part in causes:
            self.trip(code, part, lasts=True)

    def _disarm(self) -> None:
        """Open the bridge."""
        self._run_to(self._now_ns)
        self._armed_ns = NEVER_NS
        was_armed, self.state = self.is_armed, wire.IDLE
        if was_armed:
            self._result = wire.DISARMED
        self._motor.command(Mode.COAST)
        self._note_change()

    def _note_change(self) -> None:
        if self._settings.heartbeat_on_change and self._now_ns >= self._ready_ns:
            self._send_heartbeat()

    def _arm(self) -> None:
        """Enter closed-loop control, if nothing is in its way."""
        if self._has_errors:
            self._result = wire.DISARMED
            return
        if not self._settings.calibrated:
            if self._is_old:
                self.axis_error |= Errors05.AXIS_INVALID_STATE
            self._result = wire.NOT_CALIBRATED
            self._note_change()
            return
        self.state, self._result = wire.CLOSED_LOOP, wire.SUCCESS
        self._drive()
        self._note_change()

    def _drive(self) -> None:
        """Give the motor its set-point."""
        if not self.is_armed:
            return
        self._run_to(self._now_ns)
        ramps = self._input_mode == wire.VEL_RAMP
        rate = self._settings.vel_ramp_rate * _TURN if ramps else math.inf
        self._motor.axis.limits = Limits(current_a=self._current_a, acceleration_rad_s2=rate)
        if self._mode == wire.VELOCITY_CONTROL:
            limit = self._vel_limit
            self._motor.command(Mode.SPEED, min(max(self._input_vel, -limit), limit) * _TURN)
        elif self._mode == wire.TORQUE_CONTROL:
            self._motor.command(Mode.CURRENT, 0.0)
        else:
            self._motor.command(Mode.SPEED, 0.0)

    # Messages in --------------------------------------------------------------------------------

    def _set_handlers(self) -> None:
        """Listen to data and remote requests of all commands of the node."""
        for command in wire.COMMANDS:
            self._handlers[self._id | command] = self._data_handler(command)
            self._handlers[self._id | command | REMOTE_FLAG] = self._request_handler(command)

    def _data_handler(self, command: int) -> Callable[[bytes, int], None]:
        takes = self._takes().get(command)
        answers = self._answers().get(command)

        def handle(data: bytes, now_ns: int) -> None:
            if now_ns < self._ready_ns:
                return
            self._feed(command)
            if takes is not None:
                takes(data.ljust(8, b"\0"))
            elif answers is not None and not data:
                answers()  # as if it were a remote request
            self._check()

        return handle

    def _request_handler(self, command: int) -> Callable[[bytes, int], None]:
        answers = self._answers().get(command)

        def handle(_: bytes, now_ns: int) -> None:
            if now_ns < self._ready_ns:
                return
            self._feed(command)
            if answers is not None:
                answers()
            self._check()

        return handle

    def _feed(self, command: int) -> None:
        """Feed the watchdog, if such a message does."""
        if self._is_old or self._settings.watchdog_fed_by == "any" or command in _FEEDS:
            self._expires_ns = self._now_ns + self._timeout_ns()

    def _takes(self) -> dict[int, Callable[[bytes], None]]:
        """Return what takes data of each command."""
        takes: dict[int, Callable[[bytes], None]] = {
            wire.ESTOP: lambda _: self._trip(Errors05.AXIS_ESTOP, Errors06.ESTOP),
            wire.SET_AXIS_STATE: self._on_state,
            wire.SET_CONTROLLER_MODE: self._on_mode,
            wire.SET_INPUT_VEL: self._on_velocity,
            wire.SET_LIMITS: self._on_limits,
            wire.REBOOT: self._on_reboot,
            wire.CLEAR_ERRORS: self._on_clear,
        }
        if not self._is_old:
            takes[wire.RX_SDO] = self._on_sdo
        return takes

    def _on_state(self, data: bytes) -> None:
        (state,) = wire.UINT32.unpack_from(data)
        if state == wire.CLOSED_LOOP:
            if not self.is_armed:
                self._result = wire.BUSY
                self._armed_ns = self._now_ns + round(self._settings.arming_ms * _MS)
        elif state == wire.IDLE:
            self._result = wire.SUCCESS
            if self.is_armed or self._armed_ns != NEVER_NS:
                self._disarm()
                self._result = wire.SUCCESS

    def _on_mode(self, data: bytes) -> None:
        self._mode, self._input_mode = wire.TWO_UINT32.unpack_from(data)
        self._drive()

    def _on_velocity(self, data: bytes) -> None:
        velocity, torque = wire.TWO_FLOATS.unpack_from(data)
        if math.isfinite(velocity) and math.isfinite(torque):
            self._input_vel, self._input_torque = velocity, torque
            self._drive()

    def _on_limits(self, data: bytes) -> None:
        self._vel_limit, self._current_a = wire.TWO_FLOATS.unpack_from(data)
        self._drive()

    def _on_clear(self, _: bytes) -> None:
        self._clear()
        self._note_change()

    def _on_reboot(self, data: bytes) -> None:
        action = data[0] if data and not self._is_old else 0
        if not self._is_old and self.is_armed:
            return  # only an idle axis does
        if action == wire.SAVE:
            (timeout,) = wire.UINT32.unpack(self._timeout)
            self._store.save({(0, 0): timeout, (0, 1): int(self._is_watched)})
        elif action == wire.ERASE:
            self._store.clear()
        self._start(self._now_ns)

    def _on_sdo(self, data: bytes) -> None:
        """Read or write one of the two endpoints that the twin has."""
        if len(data) < wire.SDO.size:
            return
        opcode, endpoint, _ = wire.SDO.unpack_from(data)
        value = data[wire.SDO.size :]
        timeout, enable = self._settings.watchdog_endpoints
        if endpoint == timeout:
            if opcode == 1 and len(value) >= 4:
                self._timeout = value[:4]
            self._confirm(opcode, endpoint, self._timeout)
        elif endpoint == enable:
            if opcode == 1 and value:
                self._is_watched = bool(value[0])
            self._confirm(opcode, endpoint, bytes((self._is_watched,)))

    def _confirm(self, opcode: int, endpoint: int, value: bytes) -> None:
        """Answer a reading; from firmware 0.6.11 on a writing, too."""
        if opcode == 1 and self._settings.firmware < (0, 6, 11):
            return
        if self._settings.pads_sdo:
            value = value.ljust(4, b"\0")
        self._send(wire.TX_SDO, wire.SDO.pack(0, endpoint, 0) + value)

    # Messages out -------------------------------------------------------------------------------

    def _send(self, command: int, data: bytes) -> None:
        self.send(self._id | command, data)

    def _answers(self) -> dict[int, Callable[[], None]]:
        """Return what answers a request for each message."""
        answers: dict[int, Callable[[], None]] = {
            wire.ENCODER_ESTIMATES: self._send_estimates,
            wire.IQ: self._send_current,
            wire.BUS_VOLTAGE_CURRENT: self._send_supply,
        }
        if self._is_old:
            answers |= {
                wire.MOTOR_ERROR: lambda: self._send(
                    wire.MOTOR_ERROR, wire.UINT64.pack(self.motor_error)
                ),
                wire.ENCODER_ERROR: lambda: self._send(
                    wire.ENCODER_ERROR, wire.TWO_UINT32.pack(self.encoder_error, 0)
                ),
                wire.SENSORLESS_ERROR: lambda: self._send(wire.SENSORLESS_ERROR, bytes(8)),
                wire.ENCODER_COUNT: self._send_count,
                wire.CONTROLLER_ERROR: lambda: self._send(
                    wire.CONTROLLER_ERROR, wire.TWO_UINT32.pack(self.controller_error, 0)
                ),
            }
        else:
            answers |= {
                wire.VERSION: self._send_version,
                wire.ERROR: lambda: self._send(
                    wire.ERROR, wire.TWO_UINT32.pack(self.active_errors, self.disarm_reason)
                ),
                wire.TEMPERATURE: self._send_temperature,
            }
        return answers

    def _send_heartbeat(self) -> None:
        if self._is_old:
            data = wire.HEARTBEATS.pack(
                self.axis_error,
                self.state,
                self.motor_error != 0,
                self.encoder_error != 0,
                self.controller_error != 0,
            )
        else:
            errors = self.active_errors | self.disarm_reason
            data = wire.HEARTBEATS.pack(errors, self.state, self._result, 0, 0)
        self._send(wire.HEARTBEAT, data)

    def _send_version(self) -> None:
        settings = self._settings
        versions = (*settings.hardware, *settings.firmware, settings.unreleased)
        self._send(wire.VERSION, bytes((wire.PROTOCOL_VERSION, *versions)))

    def _send_estimates(self) -> None:
        self._run_to(self._now_ns)
        turns = self._motor.encoder_count(_COUNTS_PER_TURN) / _COUNTS_PER_TURN
        data = wire.TWO_FLOATS.pack(turns, self._motor.speed_rad_s / _TURN)
        self._send(wire.ENCODER_ESTIMATES, data)

    def _send_count(self) -> None:
        self._run_to(self._now_ns)
        count = self._motor.encoder_count(_COUNTS_PER_TURN)
        shadow = (count + 2**31) % 2**32 - 2**31
        self._send(wire.ENCODER_COUNT, wire.TWO_INT32.pack(shadow, count % _COUNTS_PER_TURN))

    def _send_current(self) -> None:
        self._run_to(self._now_ns)
        current_a = self._motor.current_a
        data = wire.TWO_FLOATS.pack(current_a if self.is_armed else 0.0, current_a)
        self._send(wire.IQ, data)

    def _send_supply(self) -> None:
        self._run_to(self._now_ns)
        supply = self._stage.bus_voltage_v, self._motor.axis.supply_current_a
        self._send(wire.BUS_VOLTAGE_CURRENT, wire.TWO_FLOATS.pack(*supply))

    def _send_temperature(self) -> None:
        self._run_to(self._now_ns)
        settings = self._settings
        motor_c = self._motor.axis.temperature_c if settings.motor_thermistor else math.nan
        self._send(wire.TEMPERATURE, wire.TWO_FLOATS.pack(settings.inverter_c, motor_c))
