"""Plausibility: consistency of the inputs with each other.

An input can be fresh, undamaged and wrong. Each monitor here compares inputs that come from
different sensors:

- encoder against duty and current. The voltage at a motor less the drop over its winding is its
  back-EMF, hence its speed, whatever its load: ``w = (u - R i) / k``. An encoder that disagrees is
  stuck, disconnected, reversed, swapped with its neighbour, or loses counts;
- current against motion. High current in one direction without matching speed: the wheel is
  blocked, or the robot pushes against something;
- wheel against wheel. Errors of supply, temperature and model are those of both wheels; what
  differs between them is one wheel's own;
- steering against its command, supply against battery, the drive's clock against the host's;
- sonar against odometry: `plausibility_sonar.py`; each sensor alone: `plausibility_values.py`.

Undetectable: a wheel and its motor both swapped with the other side's, if no sonar sees it; slip on
ice with no sonar echo ahead; tilt and being carried, since there is no IMU. No monitor leads to a
degraded mode: each stops the robot.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from robotctl.messages.control import (
    DriveStatus,
    MotorStatus,
    WheelCommand,
    WheelFeedback,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.monitor import MonitorInputs
from robotctl.safety.plausibility_config import PlausibilityConfig

COPPER_PER_K: Final = 0.0039
"""Growth of a copper winding's resistance [1/K], from 25 degC."""

REST_RAD_S: Final = 0.5
"""A wheel slower than this counts as at rest [rad/s]."""

GAIN_RAD_S: Final = 3.0
"""A push that gains more speed than this in its direction meets inertia, not a wall [rad/s]."""

GAIN_SHARE: Final = 1.0 / 3.0
"""Sufficient share of the speed gained at maximum acceleration, if that is less."""

PAIR_RAD_S: Final = 4.0
"""Wheels are compared from this speed on at the latest [rad/s], or from twice the tolerance."""

JUMPS: Final = 3
"""Impossible jumps of a count within a second that make a fault: one glitch makes two."""

CLOCK_WINDOW_NS: Final = 2_000_000_000
_CLOCK_GAP_NS: Final = 500_000_000
_SECOND_NS: Final = 1_000_000_000


class PersistenceTimer:
    """How long a condition has held without a break."""

    __slots__ = ("_since_ns",)

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def lasts_ns(self, condition: bool, now_ns: int) -> int:
        """Return how long the condition has held up to now [ns]; 0 if it does not."""
        if not condition:
            self._since_ns = None
            return 0
        if self._since_ns is None:
            self._since_ns = now_ns
        return now_ns - self._since_ns


class WheelMonitor:
    """Encoder, current and motion of one wheel.

    Parameters
    ----------
    name
        Name of the wheel.
    config
        Tolerances.
    a_max_rad_s2
        Acceleration of the wheel at the robot's limit [rad/s^2], > 0.
    """

    def __init__(self, name: str, config: PlausibilityConfig, a_max_rad_s2: float) -> None:
        self.name = name
        self._config = config
        self._speed_ns = config.speed_ms * 1_000_000
        self._push_ns = config.push_ms * 1_000_000
        self._gain_rad_s = min(GAIN_RAD_S, GAIN_SHARE * a_max_rad_s2 * config.push_ms * 1e-3)
        self.reset()

    def reset(self) -> None:
        """Reset the timers."""
        self.counted_rad_s = 0.0
        self.electrical_rad_s = 0.0
        self.is_off = False
        """Whether the encoder has disagreed with the motor for too long."""
        self._off = PersistenceTimer()
        self._drop_v = self._current_a = self._before_rad_s = 0.0
        self._push = 0
        self._pushing = PersistenceTimer()

    @property
    def tolerance_rad_s(self) -> float:
        """Present tolerance between the two speeds [rad/s]."""
        config = self._config
        faster = max(abs(self.counted_rad_s), abs(self.electrical_rad_s))
        return config.speed_tolerance_rad_s + config.speed_tolerance_share * faster

    @property
    def ratio(self) -> float:
        """Counted over electrical speed; nan if they are not compared yet."""
        least_rad_s = min(PAIR_RAD_S, 2.0 * self._config.speed_tolerance_rad_s)
        if abs(self.electrical_rad_s) < least_rad_s:
            return math.nan
        return self.counted_rad_s / self.electrical_rad_s

    def update(
        self,
        counted_rad_s: float,
        voltage_v: float,
        current_a: float,
        temperature_c: float,
        stamp_ns: int,
    ) -> None:
        """Take one sample of an enabled wheel.

        Parameters
        ----------
        counted_rad_s
            Speed by the encoder [rad/s].
        voltage_v
            Mean voltage at the motor [V].
        current_a, temperature_c
            Of its winding [A, degC].
        stamp_ns
            Time of the sample [ns].
        """
        config = self._config
        # A hot winding has up to half as much resistance again: compensate, or heat looks like a
        # fault.
        warm = 1.0 + COPPER_PER_K * (temperature_c - 25.0)
        self._drop_v = config.resistance_ohm * warm * current_a
        self._current_a = current_a
        self.counted_rad_s = counted_rad_s
        # Back-EMF: w = (u - R i) / k, whatever the load.
        self.electrical_rad_s = (voltage_v - self._drop_v) / config.back_emf_v_s_rad
        excess = abs(self.electrical_rad_s - counted_rad_s) / self.tolerance_rad_s
        # Duration times excess: twice the error is judged in half the time, because swapped
        # encoders accelerate a loop more the faster it is.
        self.is_off = self._off.lasts_ns(excess > 1.0, stamp_ns) * excess > self._speed_ns

    def encoder_fault(self) -> Fault | None:
        """Return the encoder's fault; None if there is none."""
        if not self.is_off:
            return None
        counted, electrical = self.counted_rad_s, self.electrical_rad_s
        if abs(counted) < REST_RAD_S:
            code, kind = FaultCode.ENCODER_STUCK, "stuck or disconnected"
        elif counted * electrical < 0.0:
            code, kind = FaultCode.ENCODER_REVERSED, "reversed"
        else:
            code, kind = FaultCode.ENCODER_WRONG, "wrong"
        text = (
            f"{self.name} encoder {kind}: {counted:.1f} rad/s counted, {electrical:.1f} rad/s by "
            "duty and current"
        )
        return Fault(code, text, self.name)

    def push_fault(self, now_ns: int) -> Fault | None:
        """Return the fault of a blocked wheel; None if it is free."""
        counted, push_v = self.counted_rad_s, self._config.push_v
        push = (self._drop_v > push_v) - (self._drop_v < -push_v)
        if push != self._push:
            self._push, self._pushing = push, PersistenceTimer()
        lasts_ns = self._pushing.lasts_ns(push != 0, now_ns)
        if lasts_ns == 0:
            self._before_rad_s = counted
        if lasts_ns <= self._push_ns:
            return None
        if push * (counted - self._before_rad_s) > self._gain_rad_s:
            # The current does its work. A wheel that loses speed against it is held.
            self._pushing = PersistenceTimer()
            return None
        if abs(counted) < REST_RAD_S:
            text = f"{self.name} wheel is blocked: {self._current_a:.1f} A and no motion"
            return Fault(FaultCode.WHEEL_BLOCKED, text, self.name)
        text = f"{self.name} wheel pushes against something: {self._current_a:.1f} A, no faster"
        return Fault(FaultCode.WHEEL_PUSHES, text, self.name)


class Plausibility:
    """All monitors but the sonars'.

    Parameters
    ----------
    config
        Tolerances.
    wheel_names
        The driven wheels.
    deadband
        Of the bridges.
    steering_max_rad
        Bound of the linkage [rad]; 0: no steering.
    a_max_rad_s2
        Acceleration of a wheel at the robot's limit [rad/s^2], > 0.
    """

    def __init__(
        self,
        config: PlausibilityConfig,
        wheel_names: tuple[str, ...],
        deadband: float,
        steering_max_rad: float,
        a_max_rad_s2: float,
    ) -> None:
        self._config = config
        self._deadband = deadband
        self._steering_max_rad = steering_max_rad
        self._wheels = tuple(WheelMonitor(name, config, a_max_rad_s2) for name in wheel_names)
        self.reset()

    def reset(self) -> None:
        """Reset: the robot is armed."""
        self.fault: Fault | None = None
        """The contradiction found; stays until `reset`."""
        for wheel in self._wheels:
            wheel.reset()
        self._pair = PersistenceTimer()
        self._steering = PersistenceTimer()
        self._jumps = -1
        self._jumped_ns: deque[int] = deque(maxlen=JUMPS)
        self._latch_us, self._host_ns = -1, 0
        self._drive_us = self._elapsed_ns = 0

    def update(self, inputs: MonitorInputs) -> Fault | None:
        """Take the inputs of one tick; return the first contradiction since the last `reset`."""
        feedback, motor = inputs.feedback, inputs.feedback.motor
        if feedback.wheels is not None:
            self.take_wheels(feedback.wheels)
        if feedback.drive is not None:
            self.take_drive(feedback.drive, inputs.command)
        if motor is not None and inputs.supply_v is not None:
            motion = inputs.motion
            self.take_motor(
                motor, inputs.command, inputs.supply_v, motion.speeds_rad_s, motion.jumps
            )
        return self.fault

    def take_wheels(self, wheels: WheelFeedback) -> None:
        """Compare the drive's clock with the host's, over windows of `CLOCK_WINDOW_NS`."""
        latch_us, stamp_ns = wheels.timestamp_us, wheels.stamp_ns
        host_ns = stamp_ns - self._host_ns
        if self._latch_us < 0 or host_ns > _CLOCK_GAP_NS:
            self._drive_us = self._elapsed_ns = 0
        else:
            # The time stamp has 20 bits of microseconds and rolls over every 1.05 s.
            self._drive_us += (latch_us - self._latch_us) & 0xFFFFF
            self._elapsed_ns += host_ns
            if self._elapsed_ns >= CLOCK_WINDOW_NS:
                excess = self._drive_us * 1000.0 / self._elapsed_ns - 1.0
                if abs(excess) > self._config.clock_share:
                    text = f"the drive's clock runs {excess:+.1%} against the host's"
                    self._say(Fault(FaultCode.CLOCK_DRIFT, text, "drive"))
                self._drive_us = self._elapsed_ns = 0
        self._latch_us, self._host_ns = latch_us, stamp_ns

    def take_motor(
        self,
        motor: MotorStatus,
        command: WheelCommand,
        bus_voltage_v: float,
        speeds_rad_s: tuple[float, ...],
        jumps: int,
    ) -> None:
        """Compare the wheels with their motors.

        Parameters
        ----------
        motor
            The sample.
        command
            Command of the bridges when it was taken.
        bus_voltage_v
            Supply [V].
        speeds_rad_s
            Speed of each wheel by its encoder [rad/s].
        jumps
            Number of impossible jumps of the counts so far.
        """
        if not command.enable:
            return
        currents = motor.current1_a, motor.current2_a
        temperatures = motor.temperature1_c, motor.temperature2_c
        duties = command.duty1, command.duty2
        for index, wheel in enumerate(self._wheels):
            wheel.update(
                speeds_rad_s[index],
                self._effective(duties[index]) * bus_voltage_v,
                currents[index],
                temperatures[index],
                motor.stamp_ns,
            )
        self._check_jumps(jumps, motor.stamp_ns)
        self._check_encoders(motor.stamp_ns)
        for wheel in self._wheels:
            if held := wheel.push_fault(motor.stamp_ns):
                self._say(held)

    def _effective(self, duty: float) -> float:
        """Return the share of the supply that a duty gives to the motor."""
        share = max(0.0, abs(duty) - self._deadband) / (1.0 - self._deadband)
        return math.copysign(share, duty)

    def _check_encoders(self, now_ns: int) -> None:
        """Report swapped encoders as such, otherwise each alone; then compare the pair."""
        wheels = self._wheels
        # Before the single encoders, both of which would be reported as wrong.
        if len(wheels) == 2 and self._exchanged(*wheels):
            text = "left and right encoders are swapped"
            self._say(Fault(FaultCode.ENCODERS_SWAPPED, text))
        for wheel in wheels:
            if wrong := wheel.encoder_fault():
                self._say(wrong)
        if len(wheels) == 2:
            one, other = wheels[0].ratio, wheels[1].ratio
            # False for nan.
            apart = abs(one - other) > self._config.pair_share
            if self._pair.lasts_ns(apart, now_ns) > self._config.pair_ms * 1_000_000:
                text = (
                    f"{wheels[0].name} and {wheels[1].name} wheel contradict each other: counted "
                    f"over electrical speed is {one:.2f} and {other:.2f}"
                )
                self._say(Fault(FaultCode.WHEELS_CONTRADICT, text))

    def _exchanged(self, one: WheelMonitor, other: WheelMonitor) -> bool:
        """Return whether each wheel's count fits the other's motor, and not its own."""
        if not (one.is_off and other.is_off):
            return False
        # Each count matches the other side's motor: plugs swapped, not two faults.
        first = abs(one.electrical_rad_s - other.counted_rad_s) <= other.tolerance_rad_s
        return first and abs(other.electrical_rad_s - one.counted_rad_s) <= one.tolerance_rad_s

    def _check_jumps(self, jumps: int, now_ns: int) -> None:
        """Look whether the last `JUMPS` impossible jumps came within a second."""
        if self._jumps >= 0:
            last_ns = self._jumped_ns
            last_ns.extend([now_ns] * min(jumps - self._jumps, JUMPS))
            if len(last_ns) == JUMPS and last_ns[-1] - last_ns[0] <= _SECOND_NS:
                text = f"encoder counts jump: {JUMPS} times within a second"
                self._say(Fault(FaultCode.ENCODER_JUMPS, text))
        self._jumps = jumps

    def take_drive(self, drive: DriveStatus, command: WheelCommand) -> None:
        """Compare the steering with its command."""
        if not command.enable or self._steering_max_rad == 0.0:
            return
        config = self._config
        error_rad = abs(drive.steering_rad - command.steering_rad)
        apart = error_rad > config.steering_tolerance_rad
        if self._steering.lasts_ns(apart, drive.stamp_ns) > config.steering_ms * 1_000_000:
            text = (
                f"the steering is at {drive.steering_rad:.2f} rad, commanded to "
                f"{command.steering_rad:.2f} rad"
            )
            self._say(Fault(FaultCode.STEERING_OFF, text))

    def _say(self, fault: Fault) -> None:
        """Keep the first fault."""
        self.fault = self.fault or fault
