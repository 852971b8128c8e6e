"""The process of the lidars: revolutions in, scans for localisation and map out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Final

from robotctl.app.processes.entry import enter
from robotctl.app.processes.lidar_scans import LidarScans
from robotctl.app.processes.sensor_sockets import SensorSockets
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.drivers.lidar.rplidar import Rplidar
from robotctl.errors import ConfigError
from robotctl.messages.lidar_port import LidarPort
from robotctl.messages.ports import Clock
from robotctl.model.sensors.lidar import SOCKET, LidarConfig
from robotctl.runtime.clock import RealClock
from robotctl.runtime.ipc.topics import Endpoints, endpoint_directory

LIDAR_DRIVERS: Final[dict[str, Callable[[LidarConfig, Clock], LidarPort]]] = {
    "rplidar": lambda config, clock: Rplidar(config.device, config.baud, clock),
}
"""Drivers by `lidar.driver`."""


def run(config: RobotConfig, options: StackOptions) -> None:
    """Scan until SIGTERM or SIGINT.

    Raises
    ------
    ConfigError
        If the robot's file names no lidar that has a driver here.
    LinkError
        If the lidar cannot be opened, or falls silent.
    """
    stopped = StopFlag()
    clock = RealClock()
    if not config.lidars or any(each.driver == SOCKET for each in config.lidars):
        raise ConfigError(f"lidar.driver: allowed are here: {', '.join(LIDAR_DRIVERS)}")
    endpoints = Endpoints(endpoint_directory(options.instance))
    with ExitStack() as stack:
        lidars = [
            stack.enter_context(closing(LIDAR_DRIVERS[each.driver](each, clock)))
            for each in config.lidars
        ]
        makers = [LidarScans(each) for each in config.lidars]
        sockets = stack.enter_context(SensorSockets(endpoints, endpoints.lidar))
        while not stopped():
            sockets.beat()
            sweeps = [lidar.read() for lidar in lidars]
            states = list(sockets.states())
            for scans, sweep in zip(makers, sweeps, strict=True):
                for state in states:
                    scans.attend(state)
                if sweep is not None:
                    sockets.publisher.send(scans.scan(sweep))


if __name__ == "__main__":
    sys.exit(enter("lidar", run, device_may_come=True))
