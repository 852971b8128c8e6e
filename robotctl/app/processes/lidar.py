"""The lidar process: revolutions in, scans for localisation and map out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import closing
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
    if config.lidar is None or config.lidar.driver == SOCKET:
        raise ConfigError(f"lidar.driver: allowed are here: {', '.join(LIDAR_DRIVERS)}")
    lidar = LIDAR_DRIVERS[config.lidar.driver](config.lidar, clock)
    endpoints = Endpoints(endpoint_directory(options.instance))
    with closing(lidar), SensorSockets(endpoints, endpoints.lidar) as sockets:
        scans = LidarScans(config.lidar)
        while not stopped():
            sockets.beat()
            sweep = lidar.read()
            for state in sockets.states():
                scans.attend(state)
            if sweep is not None:
                sockets.publisher.send(scans.scan(sweep))


if __name__ == "__main__":
    sys.exit(enter("lidar", run, device_may_come=True))
