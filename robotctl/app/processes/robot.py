"""Objects of a robot, from its configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack

import robotctl
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig, config_directory, robot_to_json
from robotctl.core.checkpoint import fields_of
from robotctl.core.config import fastest_wheel_rad_s
from robotctl.core.control_core import ControlCore
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import load_dbc
from robotctl.drivers.can.drives.fitting import actuators_of, fit
from robotctl.drivers.can.nodes.registry import age_limits
from robotctl.drivers.can.nodes.robot_codec import RobotCodec
from robotctl.drivers.can.port import SocketPort
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.drivers.can.robot_parts import RobotParts
from robotctl.messages.ports import Clock
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.flight.recorder import RecordHeader
from robotctl.safety.ages import AgeLimit


def make_core(config: RobotConfig, options: StackOptions) -> ControlCore:
    """Return the control core of a robot."""
    return ControlCore(
        config.drive,
        actuators_of(fit(config.drive, config.motors)),
        config.control,
        config.limits,
        config.safety,
        config.plausibility,
        feedback_ages(config),
        config.runtime.period_ns,
        config.sonar,
        config.imu,
        SE2(options.x_m, options.y_m, options.theta_rad),
    )


def make_codec() -> RobotCodec:
    """Return the codec of `robot.dbc`."""
    return RobotCodec(load_dbc(config_directory() / "robot.dbc"))


def node_parameters(config: RobotConfig) -> NodeParameters:
    """Return the required and configured settings of a robot's nodes."""
    return NodeParameters(
        rate_hz=config.runtime.rate_hz,
        command_timeout_ms=config.safety.command_timeout_ms,
        heartbeat_timeout_ms=config.safety.heartbeat_timeout_ms,
        sonars=len(config.sonar),
        imu=config.imu.enabled,
        power=config.power,
    )


def feedback_ages(config: RobotConfig) -> tuple[AgeLimit, ...]:
    """Return how old what a robot's drives and nodes tell may be."""
    safety, period_ns = config.safety, config.runtime.period_ns
    return (
        *(limit for motor in config.motors for limit in motor.ages(safety, period_ns)),
        *age_limits(node_parameters(config), safety, period_ns),
    )


def make_parts(
    config: RobotConfig, codec: RobotCodec, proofs: Mapping[str, str] | None = None
) -> RobotParts:
    """Return the drives and sensor nodes of a robot.

    Parameters
    ----------
    config
        The robot.
    codec
        Of our own protocol.
    proofs
        Settings with which its drives were proven; None: no drive needs a proof.

    Raises
    ------
    ConfigError
        If a drive cannot do what the robot needs, or two parts share a frame.
    """
    return RobotParts(
        codec,
        node_parameters(config),
        fit(config.drive, config.motors),
        fastest_wheel_rad_s(config.drive, config.limits),
        [bus.name for bus in config.buses],
        config.nodes,
        proofs,
    )


def open_ports(
    config: RobotConfig, identifiers: Callable[[str], Sequence[int]], clock: Clock
) -> dict[str, SocketPort]:
    """Return a port on each of the robot's buses, by the name of the bus.

    Parameters
    ----------
    config
        The robot.
    identifiers
        Identifiers of the frames to receive on the bus of a name.
    clock
        Clock that stamps the frames.

    Raises
    ------
    LinkError
        If one cannot be opened; none is open then.
    """
    with ExitStack() as opened:
        ports = {}
        for bus in config.buses:
            ports[bus.name] = port = SocketPort(bus, identifiers(bus.name), clock)
            opened.callback(port.close)
        opened.pop_all()
    return ports


def make_robot(config: RobotConfig, clock: Clock) -> CanRobot:
    """Return the robot on its CAN buses.

    Raises
    ------
    ConfigError
        As `make_parts`.
    LinkError
        If a bus cannot be opened.
    """
    # What hangs on simulated buses hurts nobody.
    is_simulated = all(bus.interface == "simcan" for bus in config.buses)
    parts = make_parts(config, make_codec(), None if is_simulated else config.proof)
    return CanRobot(open_ports(config, parts.identifiers, clock), parts)


def record_header(config: RobotConfig, options: StackOptions) -> RecordHeader:
    """Return the data from which a replay builds the same core."""
    return RecordHeader(
        version=robotctl.__version__,
        robot_json=robot_to_json(config),
        x_m=options.x_m,
        y_m=options.y_m,
        theta_rad=options.theta_rad,
        fields=fields_of(make_core(config, options)),
        epoch_ns=options.epoch_ns,
    )
