"""The buses of a real robot, claimed against other controllers."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager

from robotctl.app.processes.robot import make_codec, make_parts, open_ports
from robotctl.config.robot_file import RobotConfig
from robotctl.deploy.doctor_nodes import is_driven
from robotctl.drivers.can.port import SocketPort
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.errors import LinkError
from robotctl.messages.ports import CanPort, Clock
from robotctl.runtime.clock import RealClock
from robotctl.runtime.ipc.process_lock import claim_bus


class RealBuses:
    """Buses of a robot.

    Parameters
    ----------
    config
        The robot.

    Attributes
    ----------
    clock
        CLOCK_MONOTONIC.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.clock: Clock = RealClock()
        self._config = config

    def open(self, identifiers: Mapping[str, Collection[int]]) -> dict[str, CanPort]:
        """Return a port on each bus that accepts some identifiers."""
        with ExitStack() as opened:
            ports: dict[str, CanPort] = {}
            for bus in self._config.buses:
                if bus.name in identifiers:
                    ports[bus.name] = port = SocketPort(bus, identifiers[bus.name], self.clock)
                    opened.callback(port.close)
            opened.pop_all()
        return ports

    @contextmanager
    def claimed(self) -> Iterator[None]:
        """Hold the right to command, after listening for another controller.

        Raises
        ------
        LinkError
            If another process holds it, or another controller drives the robot.
        """
        config = self._config
        with ExitStack() as held:
            for bus in config.buses:
                held.enter_context(claim_bus(bus.interface, bus.channel))
            parts = make_parts(config, make_codec())
            ports = open_ports(config, parts.identifiers, self.clock)
            try:
                driven = is_driven(CanRobot(ports, parts), self.clock)
            finally:
                # Not CanRobot.close, which would send.
                for port in ports.values():
                    port.close()
            if driven:
                raise LinkError("another controller commands this robot's drives; end it first")
            yield
