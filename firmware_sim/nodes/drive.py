"""CANopen node 1: two-channel motor controller with encoders, steering servo and guards.

The node samples its encoders with the power stage, every millisecond. A SYNC latches the newest
sample together with the microsecond timer at that sample, so that count and time stamp always
belong to each other, whatever the host's jitter.

The guards (command time-out, emergency stop, over-current, over-temperature, under-voltage,
encoder, duty range, E2E) work in every NMT state and cannot be switched off over SDO. While the
motors are enabled nothing of the dictionary can be written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from firmware_sim.bus.frame import REMOTE_FLAG
from firmware_sim.config.motors import CHANNELS
from firmware_sim.nodes import drive_objects as objects
from firmware_sim.nodes import wire
from firmware_sim.nodes.drive_guards import (
    NO_FAULT,
    ChannelGuard,
    ChannelSample,
    DriveFault,
    Limits,
    MotorModel,
    SupplyGuard,
)
from firmware_sim.nodes.drive_state import DriveEvent, DriveState, DriveStateMachine
from firmware_sim.nodes.e2e import Checker, CheckStatus, Protector
from firmware_sim.nodes.node import (
    GENERIC,
    MILLISECOND_NS,
    NEVER_NS,
    PARAMETERS_LOST,
    NmtState,
    Node,
    Trouble,
)
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import MotorAxis, PowerStage, UnfittedAxis
from firmware_sim.nodes.variables import AbortCode, SdoAbortError
from firmware_sim.plant.axis import Mode

GUARD_PERIOD_NS: Final = 20 * MILLISECOND_NS
"""Interval of the guards' checks, made at the next frame that touches the power stage [ns]."""
GUARD_DUE_NS: Final = 30 * MILLISECOND_NS
"""Maximum interval of the guards' checks, without such a frame [ns]."""

MAX_COUNTER_STEP: Final = 3
"""E2E_MaxDeltaCounter of MotorCommand."""
ENABLE_FRAMES: Final = 3
"""Consecutive valid commands with Enable=1 that enable the motors; a single delayed frame does
not."""
NO_ECHO: Final = 15
AGE_MAX_MS: Final = 255

_CURRENT, _VOLTAGE, _TEMPERATURE, _COMMUNICATION, _MANUFACTURER = 0x02, 0x04, 0x08, 0x10, 0x80

# Looking up an enum's member is slow; these are used with each command.
_OPERATIONAL: Final = NmtState.OPERATIONAL
_READY, _ENABLED = DriveState.READY, DriveState.ENABLED
_DRIVE: Final = Mode.DUTY
_INITIAL: Final = CheckStatus.INITIAL
_FITS_CRC: Final = (CheckStatus.INITIAL, CheckStatus.REPEATED, CheckStatus.WRONG_SEQUENCE)
"""Statuses of frames whose CRC fits; a tuple, since hashing a member of an enumeration is slow."""
_TIMEOUT: Final = DriveEvent.TIMEOUT

TROUBLES: Final = {
    DriveFault.OVER_CURRENT: Trouble(0x2310, GENERIC | _CURRENT),
    DriveFault.OVER_TEMPERATURE: Trouble(0x4310, GENERIC | _TEMPERATURE),
    DriveFault.UNDER_VOLTAGE: Trouble(0x3220, GENERIC | _VOLTAGE),
    DriveFault.ENCODER: Trouble(0x7305, GENERIC | _MANUFACTURER),
    DriveFault.COMMAND_TIMEOUT: Trouble(0x8130, GENERIC | _COMMUNICATION),
    DriveFault.PARAMETER: PARAMETERS_LOST,
}
"""EMCY of each fault: codes of CiA 301, table 26, and CiA 402-2, table 2."""

EMERGENCY_STOP_TROUBLE: Final = Trouble(0xFF01, GENERIC | _MANUFACTURER)


class DriveNode(Node):
    """The motor controller.

    Parameters
    ----------
    stage
        Power stage: supply and steering servo.
    axes
        Motors of channel 1 and, unless it is not fitted, channel 2.
    run_to
        Function that brings the power stage to a time [ns] (the last whole millisecond up to it)
        and returns the time of its state.
    model
        Parameters of the motors.
    store
        Non-volatile memory.
    current_limit_ma
        Default of object 0x2003.
    """

    def __init__(
        self,
        stage: PowerStage,
        axes: Sequence[MotorAxis],
        run_to: Callable[[int], int],
        model: MotorModel,
        store: ParameterStore | None = None,
        current_limit_ma: int = objects.DEFAULT_CURRENT_LIMIT_MA,
    ) -> None:
        dictionary = ObjectDictionary(
            objects.drive_objects(model.counts_per_revolution, current_limit_ma)
        )
        super().__init__(objects.NODE_ID, "drive", dictionary, store)
        self._stage = stage
        unfitted = UnfittedAxis(axes[0].temperature_c)
        self._axis1, self._axis2 = axes if len(axes) == CHANNELS else (axes[0], unfitted)
        self._encoder1, self._encoder2 = (
            axis.encoder(model.counts_per_revolution) for axis in (self._axis1, self._axis2)
        )
        self._run_to = run_to
        self._machine = DriveStateMachine()
        self._guards = tuple(ChannelGuard(model) for _ in axes)
        self._supply_guard = SupplyGuard()
        self._checker = Checker(wire.data_id(wire.MOTOR_COMMAND), MAX_COUNTER_STEP)
        self._feedback = Protector(wire.data_id(wire.WHEEL_FEEDBACK))
        self._motor_status = Protector(wire.data_id(wire.MOTOR_STATUS))
        self._drive_status = Protector(wire.data_id(wire.DRIVE_STATUS))
        self.faults = NO_FAULT
        """Latched faults."""
        self._forget(0)
        self._handlers[wire.EMERGENCY_STOP] = self._on_emergency_stop
        self._handlers[wire.EMERGENCY_STOP | REMOTE_FLAG] = self._on_emergency_stop
        self._handlers[wire.SYNC] = self._on_sync
        self._connect_drive_dictionary()

    @property
    def drive_state(self) -> DriveState:
        """Values of MotorStatus.State."""
        return self._machine.state

    # Start, NMT ---------------------------------------------------------------------------------

    def power_cycle(self, now_ns: int) -> None:
        """Start afresh: counts and timer at 0, latches cleared, motors off."""
        self._run_to(now_ns)
        self._machine.handle(DriveEvent.POWER_UP)
        self.faults = NO_FAULT
        self._forget(now_ns)
        super().power_cycle(now_ns)
        self._apply(0.0, 0.0, self._steering_rad, Mode.COAST)

    def _forget(self, now_ns: int) -> None:
        stage = self._stage
        self._origin1, self._origin2 = self._encoder1.count, self._encoder2.count
        self._guarded_ns = now_ns
        self._duty1 = self._duty2 = 0.0
        self._steering_rad = stage.steering_rad
        self._bridge: Mode | None = None
        for guard in self._guards:
            guard.reset()
        self._supply_guard.reset()
        for protector in (self._feedback, self._motor_status, self._drive_status):
            protector.reset()
        self._checker = Checker(wire.data_id(wire.MOTOR_COMMAND), MAX_COUNTER_STEP)
        self._accepted = self._rejected = self._range_rejects = 0
        self._timeouts = self._emergency_stops = 0
        self._enables = 0
        self._echo = NO_ECHO
        self._accepted_ns = self._heard_ns = -NEVER_NS
        self._command_image = bytes(8)
        self._syncs = [0, 0]

    def _on_power_up(self) -> None:
        self._machine.handle(DriveEvent.WARM_RESET)
        self._cache_parameters()
        self._hold(self._now_ns)

    def _on_nmt_change(self) -> None:
        if self.state is NmtState.OPERATIONAL:
            self._checker.reset()
            self._syncs = [0, 0]
            self._machine.handle(DriveEvent.OPERATIONAL)
        elif self._machine.handle(DriveEvent.LEFT_OPERATIONAL):
            self._hold(self._now_ns)

    def _on_restore_failed(self) -> None:
        self.faults |= DriveFault.PARAMETER

    def _on_stored(self) -> None:
        self.faults &= ~DriveFault.PARAMETER

    # Commands -----------------------------------------------------------------------------------

    def _on_motor_command(self, data: bytes, now_ns: int) -> None:
        if self.state is not _OPERATIONAL:
            return
        if now_ns - self._heard_ns >= self.clock.span_ns(self._timeout_ns):
            self._on_silence(now_ns)
        status = self._checker.check(data)
        if status in _FITS_CRC and not data[1] & wire.ENABLE:
            self._heed_off(now_ns)
        if status is _INITIAL:
            self._heard_ns = now_ns
            return
        if not status.usable:
            self._rejected += 1
            return
        self._heard_ns = now_ns
        command = wire.motor_command(data)
        if command is None:
            self._range_rejects += 1
            self._rejected += 1
            return
        self._accepted += 1
        self._accepted_ns = now_ns
        self._echo = data[1] & 0x0F
        self._command_image = data
        self._guard(self._run_to(now_ns))
        self._obey(command)

    def _obey(self, command: wire.MotorCommand) -> None:
        machine = self._machine
        if not command.enable:
            self._enables = 0
            if machine.handle(DriveEvent.DISABLE):
                self._steering_rad = self._stage.steering_rad  # steering keeps its angle
        elif machine.state is not _ENABLED:
            self._enables += 1
            if self._enables >= ENABLE_FRAMES:
                machine.handle(DriveEvent.ENABLE)
        if machine.state is _ENABLED:
            entered = self._bridge is not _DRIVE
            self._apply(command.duty1, command.duty2, command.steering_rad, _DRIVE)
            if entered:
                self._reschedule()
        elif machine.state is _READY:
            # Without enable the duty is ignored, but the host chooses between coasting and braking.
            bridge = Mode.SHORTED if command.brake else Mode.COAST
            if bridge is not self._bridge:
                self._apply(0.0, 0.0, self._steering_rad, bridge)

    def _heed_off(self, now_ns: int) -> None:
        """Obey a command with Enable=0 whatever its counter.

        A late one costs a moment. After delayed frames it is the host's present command, which only
        looks late by its counter.
        """
        self._enables = 0
        if self._machine.state is _ENABLED:
            self._machine.handle(DriveEvent.DISABLE)
            self._hold(now_ns)

    def _apply(self, duty1: float, duty2: float, steering_rad: float, bridge: Mode) -> None:
        self._duty1, self._duty2, self._steering_rad = duty1, duty2, steering_rad
        self._bridge = bridge
        self._axis1.command(bridge, duty1)
        self._axis2.command(bridge, duty2)
        self._stage.steer(steering_rad)

    def _hold(self, now_ns: int) -> None:
        """Stop the motors: zero duty, shorted windings, the steering where it is."""
        self._run_to(now_ns)
        self._enables = 0
        self._apply(0.0, 0.0, self._stage.steering_rad, Mode.SHORTED)

    def _on_silence(self, now_ns: int) -> None:
        """React to a command time-out: reset the E2E reference, stop if enabled."""
        self._checker.reset()
        self._expire(now_ns)

    def _expire(self, now_ns: int) -> None:
        due_ns = self._accepted_ns + self.clock.span_ns(self._timeout_ns)
        if now_ns >= due_ns and self._machine.handle(_TIMEOUT):
            self._timeouts += 1
            self._hold(now_ns)
            self._latch(DriveFault.COMMAND_TIMEOUT)

    def _on_emergency_stop(self, data: bytes, now_ns: int) -> None:
        if self._machine.handle(DriveEvent.EMERGENCY_STOP):
            self._emergency_stops += 1
            self._hold(now_ns)
            self.report(EMERGENCY_STOP_TROUBLE, data[:1])

    # Guards -------------------------------------------------------------------------------------

    def _guard(self, stage_ns: int) -> None:
        elapsed_ns = stage_ns - self._guarded_ns
        if elapsed_ns < GUARD_PERIOD_NS:
            return
        self._guarded_ns = stage_ns
        limits, voltage_v = self._limits, self._stage.bus_voltage_v
        faults = self._supply_guard.update(voltage_v, limits, elapsed_ns)
        for guard, sample in zip(self._guards, self._samples(), strict=False):
            faults |= guard.update(sample, voltage_v, limits, elapsed_ns)
        if faults:
            if self._machine.handle(DriveEvent.FAULT):
                self._hold(stage_ns)
            self._latch(DriveFault(faults))

    def _samples(self) -> tuple[ChannelSample, ChannelSample]:
        one, two = self._axis1, self._axis2
        count1, count2 = self._encoder1.count, self._encoder2.count
        return (
            ChannelSample(self._duty1, one.current_a, one.temperature_c, count1),
            ChannelSample(self._duty2, two.current_a, two.temperature_c, count2),
        )

    def _latch(self, faults: DriveFault) -> None:
        for fault in faults & ~self.faults:
            self.faults |= fault
            self.report(TROUBLES[fault], bytes((int(self.faults),)))

    def _causes_present(self) -> DriveFault:
        causes = self._supply_guard.cause_present(self._stage.bus_voltage_v, self._limits)
        for guard, sample in zip(self._guards, self._samples(), strict=False):
            causes |= guard.cause_present(sample, self._limits)
        return DriveFault(causes) & self.faults

    def _clear_faults(self, _value: int) -> None:
        self._run_to(self._now_ns)
        if self._causes_present():
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        if self._machine.handle(DriveEvent.CLEAR):
            self._hold(self._now_ns)
        # Damaged parameters stay reported, since clearing does not repair them,
        lost = self.faults & DriveFault.PARAMETER  # until they are stored again
        self.faults = lost
        for guard in self._guards:
            guard.reset()
        self._supply_guard.reset()
        over = [trouble for fault, trouble in TROUBLES.items() if fault not in lost]
        self.retract(*over, EMERGENCY_STOP_TROUBLE)

    # Time ---------------------------------------------------------------------------------------

    def _step(self, now_ns: int) -> None:
        self._expire(now_ns)
        if now_ns - self._guarded_ns >= GUARD_DUE_NS:
            self._guard(self._run_to(now_ns))

    def _due_ns(self) -> int:
        due_ns = self._guarded_ns + GUARD_DUE_NS
        if self._machine.state is _ENABLED:
            return min(due_ns, self._accepted_ns + self.clock.span_ns(self._timeout_ns))
        return due_ns

    # Feedback -----------------------------------------------------------------------------------

    def _on_sync(self, _data: bytes, now_ns: int) -> None:
        stage_ns = self._run_to(now_ns)
        if self.state is not _OPERATIONAL:
            return
        self._guard(stage_ns)
        payload = self._feedback_payload(stage_ns)
        self.send(wire.WHEEL_FEEDBACK, self._feedback.protect(payload))
        syncs = self._syncs
        syncs[0] += 1
        if syncs[0] >= self._motor_status_every:
            syncs[0] = 0
            self.send(wire.MOTOR_STATUS, self._motor_status.protect(self._motor_status_payload()))
        syncs[1] += 1
        if syncs[1] >= self._drive_status_every:
            syncs[1] = 0
            payload = self._drive_status_payload(now_ns)
            self.send(wire.DRIVE_STATUS, self._drive_status.protect(payload))

    def _feedback_payload(self, stage_ns: int) -> int:
        return wire.wheel_feedback(
            self.clock.read(stage_ns) // 1000,
            self._encoder1.count - self._origin1,
            self._encoder2.count - self._origin2,
        )

    def _motor_status_payload(self) -> int:
        one, two = self._axis1, self._axis2
        return wire.motor_status(
            self._machine.state,
            one.current_a,
            two.current_a,
            one.temperature_c,
            two.temperature_c,
            faults=int(self.faults),
        )

    def _drive_status_payload(self, now_ns: int) -> int:
        age_ms = min((now_ns - self._accepted_ns) // MILLISECOND_NS, AGE_MAX_MS)
        stage = self._stage
        return wire.drive_status(
            self._echo, stage.steering_rad, stage.bus_voltage_v, age_ms, self._rejected
        )

    # Dictionary ---------------------------------------------------------------------------------

    def _is_locked(self) -> bool:
        return self._machine.state is _ENABLED

    def _cache_parameters(self) -> None:
        number = self.dictionary.number
        self._timeout_ns = number(objects.COMMAND_TIMEOUT) * MILLISECOND_NS
        self._motor_status_every = number(objects.MOTOR_STATUS_PDO, 2)
        self._drive_status_every = number(objects.DRIVE_STATUS_PDO, 2)
        self._limits = Limits(
            current_a=number(objects.CURRENT_LIMIT) * 1e-3,
            temperature_c=float(number(objects.TEMPERATURE_LIMIT)),
            voltage_v=number(objects.VOLTAGE_LIMIT) * 1e-3,
        )

    def _connect_drive_dictionary(self) -> None:
        dictionary = self.dictionary
        for index, sub_index in (
            (objects.COMMAND_TIMEOUT, 0),
            (objects.MOTOR_STATUS_PDO, 2),
            (objects.DRIVE_STATUS_PDO, 2),
            (objects.CURRENT_LIMIT, 0),
            (objects.TEMPERATURE_LIMIT, 0),
            (objects.VOLTAGE_LIMIT, 0),
        ):
            dictionary.on_write(index, sub_index, self._parameter_writer(index, sub_index))
        dictionary.on_write(objects.CLEAR_FAULTS, 0, self._clear_faults)
        dictionary.on_write(objects.COMMAND_IMAGE, 0, _refuse)
        for sub_index, reader in enumerate(
            (
                lambda: self._accepted,
                lambda: self._checker.crc_rejects,
                lambda: self._checker.sequence_rejects,
                lambda: self._checker.length_rejects + self._range_rejects,
                lambda: self._timeouts,
                lambda: self._emergency_stops,
            ),
            start=1,
        ):
            dictionary.on_read(objects.DIAGNOSTICS, sub_index, reader)
        dictionary.on_read(
            objects.COMMAND_IMAGE, 0, lambda: int.from_bytes(self._command_image, "little")
        )
        dictionary.on_read(
            objects.FEEDBACK_IMAGE, 0, lambda: self._feedback_payload(self._run_to(self._now_ns))
        )
        dictionary.on_read(objects.MOTOR_STATUS_IMAGE, 0, self._motor_status_payload)
        dictionary.on_read(
            objects.DRIVE_STATUS_IMAGE, 0, lambda: self._drive_status_payload(self._now_ns)
        )

    def _parameter_writer(self, index: int, sub_index: int) -> Callable[[int], None]:
        def write(value: int) -> None:
            self.dictionary.set(index, sub_index, value)
            self._cache_parameters()

        return write


def _refuse(_value: int) -> None:
    """Motors are commanded only by the protected PDO."""
    raise SdoAbortError(AbortCode.DEVICE_STATE)
