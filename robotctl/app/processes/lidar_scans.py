"""Scans from the revolutions of a lidar: as seen from one place, in even steps."""

from __future__ import annotations

import math

import numpy as np

from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.ranging.unwinding import from_last_place
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LidarScan
from robotctl.messages.lidar_port import LidarSweep
from robotctl.model.sensors.lidar import LidarConfig


class LidarScans:
    """Makes scans.

    A revolution takes 0.1 to 0.2 s, in which the robot drives on and turns: each sample is moved
    to where it lies from the lidar's place at the last one, by odometry.

    Parameters
    ----------
    config
        Mounting of the lidar, and which samples count.
    """

    def __init__(self, config: LidarConfig) -> None:
        self._config = config
        self._odometry = OdometryHistory()
        self._step_rad = 2.0 * math.pi / config.beams
        angles = -math.pi + self._step_rad * np.arange(config.beams)
        self._hidden = np.zeros(config.beams, dtype=np.bool_)
        for begin, end in np.radians(np.array(config.hidden_deg, dtype=np.float64).reshape(-1, 2)):
            self._hidden |= (angles - begin) % (2.0 * math.pi) <= (end - begin) % (2.0 * math.pi)

    def attend(self, control: ControlState) -> None:
        """Take a pose of the odometry."""
        self._odometry.add(control.stamp_ns, control.T_odom_base, control.odom_epoch_ns)

    def scan(self, sweep: LidarSweep) -> LidarScan:
        """Return a revolution as a scan from where the robot was at its end.

        Beams are nan if nothing was measured, inf if the echo lies beyond `max_range_m`.
        Without an echo an RPLIDAR does not say whether that is for want of anything to hit, so
        that counts as nothing measured, never as free.
        """
        config = self._config
        sign = -1.0 if config.upside_down else 1.0
        angles = math.radians(config.yaw_deg) + sign * sweep.angles_rad
        ranges = np.where(sweep.ranges_m < config.min_range_m, np.nan, sweep.ranges_m)
        mount = config.x_m, config.y_m
        angles, ranges = from_last_place(sweep.stamps_ns, angles, ranges, mount, self._odometry.at)
        beams = np.full(config.beams, np.nan)
        places = (angles + math.pi) / self._step_rad
        nearest = np.floor(places + 0.5)
        # The last to be written stays: the sample nearest to the middle of its beam.
        order = np.argsort(-np.abs(places - nearest), kind="stable")
        order = order[np.isfinite(ranges[order])]
        beams[nearest[order].astype(np.int64) % config.beams] = ranges[order]
        beams[beams > config.max_range_m] = np.inf
        beams[self._hidden] = np.nan
        return LidarScan(
            int(sweep.stamps_ns[-1]),
            config.x_m,
            config.y_m,
            -math.pi,
            self._step_rad,
            config.max_range_m,
            beams.astype("<f4").tobytes(),
            name=config.name,
        )
