"""Wheel velocity from latched encoder counts, by adaptive windowing.

A difference of two counts is wrong by up to one count: at low speed and 200 Hz that is as large as
the speed itself. A long window would cure it, but is late when the speed changes. Adaptive
windowing takes, at each sample, the longest window over which the counts still fit a constant
velocity within the resolution of the encoder: long and smooth at constant speed, short within a
few milliseconds of any change.

The velocity is the slope of the straight line from the oldest to the newest sample of the window,
so at constant speed its error is below one count per window. The window is good when this line
passes the samples between within one count, as it does for an ideal encoder at constant speed.

Source: F. Janabi-Sharifi, V. Hayward and C.-S. J. Chen, "Discrete-time adaptive windowing for
velocity estimation", IEEE Trans. Control Systems Technology 8(6), 2000 (their end-fit FOAW).
Two changes keep the cost constant: the line is tested in its middle and in its last quarter, where
a change shows first, instead of everywhere; and a sample once left out of the window stays out.
"""

from __future__ import annotations

import math
from typing import Final

STEP_MAX: Final = 32767
"""Maximum counts between two samples; more read as backwards."""

WINDOW_S: Final = 0.06
"""Default maximum window [s]."""


class WheelVelocityEstimator:
    """Velocity and unwrapped position of one wheel.

    The velocity is exactly 0 after `window_s` without a count. Its delay is half the window in use:
    at most `window_s / 2`, and at an acceleration of a counts/s^2 about sqrt(2 / a) s, beyond which
    a window would deviate from the straight line by more than a count.

    Undetectable: more than 32767 counts or 1.048 s between two samples alias. The caller must
    `resume` after such a gap and `reset` after a restart of the drive.

    Parameters
    ----------
    counts_per_revolution
        Quadrature counts per turn of the wheel, > 0.
    window_s
        Maximum window [s], (0, 0.5].
    band_counts
        Maximum deviation of a sample from the line [counts], >= 1; more for an encoder with uneven
        quadrature.
    speed_max_rad_s
        Maximum possible speed [rad/s], > 0. A sample that would need a higher one becomes a new
        reference for counts and time: position and velocity stay, `jumps` counts it.

    Raises
    ------
    ValueError
        If a parameter is outside its range.
    """

    __slots__ = (
        "_band",
        "_count",
        "_counts",
        "_jump_counts_per_us",
        "_rad_per_count",
        "_rad_s_per_count_us",
        "_started",
        "_time_us",
        "_times_us",
        "_total",
        "_window_us",
        "delay_s",
        "jumps",
        "position_rad",
        "velocity_rad_s",
    )

    def __init__(
        self,
        counts_per_revolution: int,
        window_s: float = WINDOW_S,
        band_counts: float = 1.0,
        speed_max_rad_s: float = 300.0,
    ) -> None:
        if counts_per_revolution <= 0:
            raise ValueError(
                f"counts_per_revolution: {counts_per_revolution} found, a number > 0 allowed"
            )
        if not 0.0 < window_s <= 0.5:
            raise ValueError(f"window_s: {window_s} found, (0, 0.5] allowed")
        if not 1.0 <= band_counts < math.inf:
            raise ValueError(f"band_counts: {band_counts} found, a finite number >= 1 allowed")
        if not speed_max_rad_s > 0.0:
            raise ValueError(f"speed_max_rad_s: {speed_max_rad_s} found, a number > 0 allowed")
        self._rad_per_count = 2.0 * math.pi / counts_per_revolution
        self._rad_s_per_count_us = self._rad_per_count * 1e6
        self._jump_counts_per_us = speed_max_rad_s / self._rad_s_per_count_us
        self._window_us = window_s * 1e6
        self._band = band_counts
        self.jumps = 0
        self.reset(0, 0)
        self._started = False

    def reset(self, count_u16: int, timestamp_us_u20: int) -> None:
        """Restart at this sample: velocity 0, position 0."""
        self._total = 0
        self.velocity_rad_s = 0.0
        self._reference(count_u16, timestamp_us_u20)

    def resume(self, count_u16: int, timestamp_us_u20: int) -> None:
        """Continue after a gap in which the time stamp may have rolled over.

        The turn counts, up to 32767 counts; the velocity restarts at 0.
        """
        self._total += (count_u16 - self._count + 0x8000 & 0xFFFF) - 0x8000
        self.velocity_rad_s = 0.0
        self._reference(count_u16, timestamp_us_u20)

    def _reference(self, count_u16: int, timestamp_us_u20: int) -> None:
        """Discard the window and measure from this sample on."""
        self._started = True
        self.position_rad = self._total * self._rad_per_count
        """Angle turned since `reset` [rad], unwrapped."""
        self._count = count_u16
        self._time_us = timestamp_us_u20
        self.delay_s = 0.0
        """Age of the velocity at the latch [s]: half the window in use.

        A loop that follows a ramp compares like with like when it takes the reference of that
        time: reference minus acceleration times (this and the loop's own dead time).
        """
        # The window's samples, oldest first, in unwrapped counts and microseconds.
        self._counts = [self._total]
        self._times_us = [timestamp_us_u20]

    def update(
        self,
        count_u16: int,
        timestamp_us_u20: int,
        reported_rad_s: float | None = None,  # noqa: ARG002 - all estimators share one signature
    ) -> float:
        """Take one latched sample and return the velocity [rad/s].

        The first sample after construction only sets the reference. A sample with the time stamp
        of the last one is the same latch received twice and changes nothing. Lost samples do no
        harm, since differences use the time stamps.

        Parameters
        ----------
        count_u16
            Encoder count, rolling over at 2^16 (a signed reading of the same bits will do).
        timestamp_us_u20
            Time of the latch [us], rolling over at 2^20.
        reported_rad_s
            Velocity reported by the drive [rad/s]; not used.
        """
        if not self._started:
            self.reset(count_u16, timestamp_us_u20)
            return 0.0
        elapsed_us = (timestamp_us_u20 - self._time_us) & 0xFFFFF
        if elapsed_us == 0:
            return self.velocity_rad_s
        # The counter has 16 bits: the difference modulo 2^16, as a signed number.
        step = (count_u16 - self._count + 0x8000 & 0xFFFF) - 0x8000
        if abs(step) > self._jump_counts_per_us * elapsed_us + 1.0:
            self.jumps += 1
            self._reference(count_u16, timestamp_us_u20)
            return self.velocity_rad_s
        self._count = count_u16
        total = self._total = self._total + step
        self.position_rad = total * self._rad_per_count
        now = self._time_us = self._time_us + elapsed_us
        times, counts = self._times_us, self._counts
        times.append(now)
        counts.append(total)
        while len(times) > 2 and now - times[0] > self._window_us:
            del times[0], counts[0]
        while len(times) > 2 and not self._straight():
            # An eighth at a time, because an abrupt change at a high rate would cost a long loop.
            drop = len(times) >> 3 or 1
            del times[:drop], counts[:drop]
        window_us = now - times[0]
        self.delay_s = 0.5e-6 * window_us
        self.velocity_rad_s = (total - counts[0]) * self._rad_s_per_count_us / window_us
        return self.velocity_rad_s

    def _straight(self) -> bool:
        """Return whether the window is straight within the band."""
        times, counts = self._times_us, self._counts
        t0, c0 = times[0], counts[0]
        elapsed_us, turned = times[-1] - t0, counts[-1] - c0
        # |(c_i - c0) - turned (t_i - t0) / elapsed| <= band, without the division.
        band = self._band * elapsed_us
        n = len(times) - 1
        i = n >> 1
        if not -band <= (counts[i] - c0) * elapsed_us - turned * (times[i] - t0) <= band:
            return False
        i = 3 * n >> 2
        return -band <= (counts[i] - c0) * elapsed_us - turned * (times[i] - t0) <= band
