"""One axis of an ODrive: its states, and its messages.

Sources: those of `wire.py`, `watchdog.py` and `errors.py`. Disarmed, the bridge is open, so that
the motor coasts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from firmware_sim.bus.frame import REMOTE_FLAG
from firmware_sim.drives.odrive import wire
from firmware_sim.drives.odrive.errors import Errors, Errors05, Errors06
from firmware_sim.drives.odrive.settings import ODriveSettings
from firmware_sim.drives.odrive.values import Values
from firmware_sim.drives.odrive.watchdog import Watchdog
from firmware_sim.drives.twin import NEVER_NS, Motor, Twin
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage
from firmware_sim.plant.axis import BrakeResistor, Limits, Mode

_MS: Final = 1_000_000
_TURN: Final = 2.0 * math.pi


class ODriveTwin(Twin):
    """Twin of one axis.

    Parameters
    ----------
    name
        Name of the drive.
    node_id
        Its id on the bus.
    settings
        The true drive.
    motor
        Motor of the axis.
    stage
        Power stage.
    run_to
        As for `Twin`.
    store
        Non-volatile memory of `save_configuration`: the watchdog.
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
        self._values = Values(settings, motor, stage)
        self._is_old = settings.firmware < wire.FIRST_06
        self.watchdog = Watchdog(settings, store)
        self._id = node_id << wire.NODE_SHIFT
        self._set_handlers()
        self._reset(NEVER_NS)

    def _reset(self, ready_ns: int) -> None:
        """Reset all but stored settings; messages begin at `ready_ns` [ns]."""
        settings = self._settings
        self._ready_ns = ready_ns
        self._beat_ns = ready_ns if settings.heartbeat_ms else NEVER_NS
        self._encoder_ns = ready_ns if settings.encoder_ms else NEVER_NS
        self._armed_ns = NEVER_NS
        """Start of the requested closed-loop control [ns]."""
        self.state = wire.IDLE
        self._result = wire.SUCCESS
        self._mode, self._input_mode = wire.POSITION_CONTROL, wire.PASSTHROUGH
        self._input_vel = self._input_torque = 0.0
        self._vel_limit, self._current_a = settings.vel_limit, settings.current_limit_a
        self.errors = Errors(is_old=self._is_old)
        self.watchdog.start(ready_ns)

    # Power and time -----------------------------------------------------------------------------

    def _on_power_up(self, now_ns: int) -> None:
        settings = self._settings
        if settings.brake_resistor_ohm:
            resistor = BrakeResistor(settings.brake_resistor_ohm, settings.brake_resistor_from_v)
            self._stage.fit_brake_resistor(resistor)
        self._start(now_ns)

    def _start(self, now_ns: int) -> None:
        """Start with an open bridge."""
        self._run_to(now_ns)
        self._motor.command(Mode.COAST)
        self._reset(now_ns + round(self._settings.boot_ms * _MS))

    def _due_ns(self) -> int:
        return min(self._beat_ns, self._encoder_ns, self._armed_ns, self._watchdog_due_ns())

    def _watchdog_due_ns(self) -> int:
        """Return the time at which the watchdog will expire [ns]."""
        if self.errors.has_expired:
            return NEVER_NS
        return max(self.watchdog.due_ns(is_armed=self.is_armed), self._ready_ns)

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
            self._tell(wire.ENCODER_ESTIMATES, self._values.estimates)

    # State --------------------------------------------------------------------------------------

    @property
    def is_armed(self) -> bool:
        """Whether the bridge is on."""
        return self.state == wire.CLOSED_LOOP

    def _check(self) -> None:
        """Check supply, speed, current and temperature of an armed axis."""
        if not self.is_armed:
            return
        settings = self._settings
        self._run_to(self._now_ns)
        voltage_v = self._stage.bus_voltage_v
        if voltage_v > settings.overvoltage_v:
            self._trip(Errors05.MOTOR_SYSTEM_LEVEL, Errors06.OVER_VOLTAGE, "motor")
        elif voltage_v < settings.undervoltage_v:
            self._trip(Errors05.MOTOR_SYSTEM_LEVEL, Errors06.UNDER_VOLTAGE, "motor")
        limit = settings.vel_limit_tolerance * self._vel_limit * _TURN
        if limit and abs(self._motor.speed_rad_s) > limit:
            self._trip(Errors05.CONTROLLER_OVERSPEED, Errors06.VELOCITY_LIMIT, "controller")
        if abs(self._motor.current_a) > self._current_a + settings.current_margin_a:
            self._trip(Errors05.MOTOR_CURRENT_LIMIT, Errors06.CURRENT_LIMIT, "motor")
        if settings.motor_thermistor and self._motor.temperature_c > settings.motor_max_c:
            old, new = Errors05.MOTOR_OVER_TEMPERATURE, Errors06.MOTOR_OVER_TEMPERATURE
            self._trip(old, new, "motor")

    def _trip(self, old: int, new: int, part: str = "axis") -> None:
        """Disarm with an error: its bit in firmware 0.5, with the part that has it, and in 0.6."""
        self.errors.add(old if self._is_old else new, part)
        self._disarm()

    def trip(self, code: int, part: str = "axis", *, lasts: bool = False) -> None:
        """Raise an error from outside.

        Parameters
        ----------
        code
            Bits of Active_Errors with firmware 0.6, of the part's errors with 0.5.
        part
            Part with firmware 0.5: "axis", "motor", "encoder" or "controller".
        lasts
            Whether its cause stays until `errors.heal`.
        """
        self.errors.add(code, part, lasts=lasts)
        self._disarm()

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
        """Enter closed-loop control, unless an error prevents it."""
        if self.errors.any:
            self._result = wire.DISARMED
            return
        if not self._settings.calibrated:
            if self._is_old:
                self.errors.add(Errors05.AXIS_INVALID_STATE, "axis")
            self._result = wire.NOT_CALIBRATED
            self._note_change()
            return
        self.state, self._result = wire.CLOSED_LOOP, wire.SUCCESS
        self._drive()
        self._note_change()

    def _drive(self) -> None:
        """Pass the set-point to the motor."""
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
        content = self._contents().get(command)

        def handle(data: bytes, now_ns: int) -> None:
            if now_ns < self._ready_ns:
                return
            self.watchdog.feed(command, self._now_ns)
            if takes is not None:
                takes(data.ljust(8, b"\0"))
            elif content is not None and not data:
                self._tell(command, content)  # answered like a remote request
            self._check()

        return handle

    def _request_handler(self, command: int) -> Callable[[bytes, int], None]:
        content = self._contents().get(command)

        def handle(_: bytes, now_ns: int) -> None:
            if now_ns < self._ready_ns:
                return
            self.watchdog.feed(command, self._now_ns)
            if content is not None:
                self._tell(command, content)
            self._check()

        return handle

    def _takes(self) -> dict[int, Callable[[bytes], None]]:
        """Return the handler of data of each command."""
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
        self.errors.clear()
        self._note_change()

    def _on_reboot(self, data: bytes) -> None:
        action = data[0] if data and not self._is_old else 0
        if not self._is_old and self.is_armed:
            return  # only an idle axis does
        if action == wire.SAVE:
            self.watchdog.save()
        elif action == wire.ERASE:
            self.watchdog.erase()
        self._start(self._now_ns)

    def _on_sdo(self, data: bytes) -> None:
        """Read or write an endpoint; firmware 0.6.11 and later also answers writes."""
        settings = self._settings
        opcode, endpoint, _ = wire.SDO.unpack_from(data)
        value = self.watchdog.access(opcode, endpoint, data[wire.SDO.size :])
        if value is None or (opcode == wire.WRITE and settings.firmware < (0, 6, 11)):
            return
        if settings.pads_sdo:
            value = value.ljust(4, b"\0")
        self._send(wire.TX_SDO, wire.SDO.pack(0, endpoint, 0) + value)

    # Messages out -------------------------------------------------------------------------------

    def _send(self, command: int, data: bytes) -> None:
        self.send(self._id | command, data)

    def _tell(self, command: int, content: Callable[[], bytes]) -> None:
        """Send a message with the present state."""
        self._run_to(self._now_ns)
        self._send(command, content())

    def _contents(self) -> dict[int, Callable[[], bytes]]:
        """Return the content of each message that can be requested."""
        values = self._values
        contents: dict[int, Callable[[], bytes]] = {
            wire.ENCODER_ESTIMATES: values.estimates,
            wire.IQ: lambda: values.current(is_armed=self.is_armed),
            wire.BUS_VOLTAGE_CURRENT: values.supply,
        }
        if self._is_old:
            pack = wire.TWO_UINT32.pack
            return contents | {
                wire.MOTOR_ERROR: lambda: wire.UINT64.pack(self.errors.motor),
                wire.ENCODER_ERROR: lambda: pack(self.errors.encoder, 0),
                wire.SENSORLESS_ERROR: lambda: bytes(8),
                wire.ENCODER_COUNT: values.count,
                wire.CONTROLLER_ERROR: lambda: pack(self.errors.controller, 0),
            }
        return contents | {
            wire.VERSION: values.version,
            wire.ERROR: lambda: wire.TWO_UINT32.pack(self.errors.active, self.errors.reason),
            wire.TEMPERATURE: values.temperature,
        }

    def _send_heartbeat(self) -> None:
        if self._is_old:
            data = wire.HEARTBEATS.pack(
                self.errors.axis,
                self.state,
                self.errors.motor != 0,
                self.errors.encoder != 0,
                self.errors.controller != 0,
            )
        else:
            errors = self.errors.active | self.errors.reason
            data = wire.HEARTBEATS.pack(errors, self.state, self._result, 0, 0)
        self._send(wire.HEARTBEAT, data)
