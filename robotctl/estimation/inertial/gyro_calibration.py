"""Calibration of a gyro's bias whenever the robot stands."""

from __future__ import annotations

from typing import Final

from robotctl.estimation.inertial.tracker import (
    BIAS_READINGS,
    REST_RAD_S,
    STILL_RAD_S,
    Vector,
)

TAKES_NS: Final = 3_000_000_000
"""How long it takes [ns]: the mean of 150 readings at 50 Hz, whose noise is a twelfth then."""


LEAST_READINGS: Final = 50
"""Minimum readings of a measurement."""


class GyroCalibration:
    """Takes the mean of what a gyro reads at rest.

    It fails where the robot is turned slowly and steadily: that reads as a bias does.

    Parameters
    ----------
    began_ns
        Time of its beginning [ns].

    Attributes
    ----------
    bias_rad_s
        The mean so far, about x, y and z [rad/s].
    readings
        How many it is the mean of.
    """

    def __init__(self, began_ns: int) -> None:
        self.bias_rad_s: Vector = (0.0, 0.0, 0.0)
        self.readings = 0
        self._began_ns = began_ns

    def progress(self, now_ns: int) -> float:
        """Return the share that is done [0, 1]."""
        return min(1.0, (now_ns - self._began_ns) / TAKES_NS)

    def take(self, rate_rad_s: Vector) -> str:
        """Take a reading [rad/s]; return why the robot does not stand, empty if it does."""
        self.readings += 1
        share = 1.0 / self.readings
        x, y, z = self.bias_rad_s
        off = rate_rad_s[0] - x, rate_rad_s[1] - y, rate_rad_s[2] - z
        self.bias_rad_s = x + share * off[0], y + share * off[1], z + share * off[2]
        if self.readings < BIAS_READINGS:
            return ""
        if max(map(abs, off)) > STILL_RAD_S:
            return f"the robot was turned: {_words(rate_rad_s)} rad/s after {_words((x, y, z))}"
        if max(map(abs, self.bias_rad_s)) > REST_RAD_S:
            return (
                f"the gyro reads {_words(self.bias_rad_s)} rad/s, at most {REST_RAD_S:g} at rest: "
                "the robot is turned, or the gyro is broken"
            )
        return ""


def _words(rate_rad_s: Vector) -> str:
    return ", ".join(f"{each:+.4f}" for each in rate_rad_s)
