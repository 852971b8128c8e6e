"""Encoder, current and motion of one wheel that is driven by a duty."""

from __future__ import annotations

import math
from typing import Final

from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.persistence import PersistenceTimer
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


class DutyWheelMonitor:
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
        self._resistance_ohm, self._back_emf_v_s_rad = config.motor
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
        # A hot winding has up to half as much resistance again: compensate, or heat looks like a
        # fault.
        warm = 1.0 + COPPER_PER_K * (temperature_c - 25.0)
        self._drop_v = self._resistance_ohm * warm * current_a
        self._current_a = current_a
        self.counted_rad_s = counted_rad_s
        # Back-EMF: w = (u - R i) / k, whatever the load.
        self.electrical_rad_s = (voltage_v - self._drop_v) / self._back_emf_v_s_rad
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
