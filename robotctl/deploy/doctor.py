"""`robotctl doctor`: fitness of this computer, with this robot, to drive."""

from __future__ import annotations

import getpass
import os
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from robotctl.config.robot_file import RobotConfig, load_robot
from robotctl.deploy.check_result import Finding, fail, none, ok, warn
from robotctl.deploy.doctor_can import check_link, no_kernel_link, read_link
from robotctl.deploy.doctor_host import (
    check_camera,
    check_clock_source,
    check_disk,
    check_governor,
    check_isolation,
    check_lidars,
    check_preemption,
    check_serial,
    check_time_sync,
    clock_status,
)
from robotctl.deploy.doctor_nodes import check_drives, check_nodes
from robotctl.deploy.wakeup import (
    check_lag,
    check_rights,
    check_timer_slack,
    measure_in_a_process,
)
from robotctl.drivers.mavlink.listening import refusal
from robotctl.errors import ConfigError
from robotctl.mavlink.config import MavlinkConfig
from robotctl.messages.mavlink_port import LinkConfig
from robotctl.runtime.clock import RealClock

LAG_SECONDS: Final = 5.0
BENCH_SECONDS: Final = 60.0
LOGS: Final = Path("/var/log/robotctl")


def examine(
    robot: Path,
    overrides: tuple[str, ...] = (),
    logs: Path = LOGS,
    root: Path = Path("/"),
    lag_seconds: float = LAG_SECONDS,
) -> Iterator[Finding]:
    """Yield the findings as they are made.

    Parameters
    ----------
    robot, overrides
        The robot's file and `key=value` settings on top of it.
    logs
        Folder for logs.
    root
        Folder that contains /proc, /sys and /dev.
    lag_seconds
        Duration of the measurement of wake-ups [s].
    """
    config = read_robot(robot, overrides)
    if isinstance(config, Finding):
        yield config
        return
    yield ok("configuration", f"{robot}: {config.robot.name}, {config.runtime.rate_hz} Hz")
    if config.localisation.map or config.localisation.places:
        yield _check_localisation(config, robot)
    yield from check_drives(config)
    yield from _check_buses(config)
    yield check_preemption(root)
    yield check_governor(root)
    yield check_clock_source(root)
    yield check_isolation(root, config.runtime.cpu)
    yield from _check_wakeups(config, lag_seconds)
    yield from check_disk(logs)
    yield check_camera(config.camera, root)
    yield from check_lidars(config.lidars, root)
    serial = [link.address.host for link in config.mavlink.link if link.address.kind == "serial"]
    yield from check_serial(serial, root)
    yield check_time_sync(clock_status())
    yield from check_mavlink(config.mavlink.link)
    if config.mavlink.signing_key:
        yield check_key(config.mavlink)


def read_robot(robot: Path, overrides: tuple[str, ...]) -> RobotConfig | Finding:
    """Return the configuration of a robot, or what is wrong with its file."""
    try:
        return load_robot(robot, overrides)
    except ConfigError as error:
        return fail("configuration", str(error), f"correct {robot}; robotctl config check {robot}")


def _check_localisation(config: RobotConfig, robot: Path) -> Finding:
    """Check that the map and the places of the robot's file load."""
    # It loads numba.
    from robotctl.app.localisation.localisation_files import check_localisation  # noqa: PLC0415

    check = "map and places"
    try:
        check_localisation(config, robot)
    except ConfigError as error:
        fix = f"put the file there, or correct {robot}; robotctl config check {robot}"
        return fail(check, str(error), fix)
    named = (config.localisation.map, config.localisation.places)
    return ok(check, ", ".join(filter(None, named)))


def _check_buses(config: RobotConfig) -> Iterator[Finding]:
    """Check each bus's link, then the nodes; with several buses each finding names its bus."""
    are_up, is_one = True, len(config.buses) == 1
    for bus in config.buses:
        if bus.interface == "socketcan":
            findings = check_link(bus, read_link(bus.channel))
        else:
            findings = [no_kernel_link(bus)]
        are_up = are_up and not findings[0].fix
        for each in findings:
            yield (
                each if is_one else msgspec.structs.replace(each, check=f"{each.check}, {bus.name}")
            )
    if are_up:
        yield from check_nodes(config, RealClock())
    else:
        yield none("CAN nodes", "not checked: the link is not up")


def _check_wakeups(config: RobotConfig, seconds: float) -> list[Finding]:
    """Check real-time rights and lag in a process of their own."""
    try:
        wakeups = measure_in_a_process(config.runtime, seconds)
    except (OSError, subprocess.SubprocessError, msgspec.DecodeError) as error:
        return [fail("wake-up lag", f"could not be measured: {error}", "report this message")]
    return [check_rights(wakeups, _user()), check_timer_slack(wakeups), check_lag(wakeups)]


def _user() -> str:
    """Return the user's name, or the id of one without a name, as in a container."""
    if os.geteuid() == 0:
        return "root"
    try:
        return getpass.getuser()
    except KeyError:
        return f"user {os.geteuid()}"


def check_mavlink(links: tuple[LinkConfig, ...]) -> list[Finding]:
    """Check each MAVLink address: names resolve, listening ports are free or ours.

    Two links that listen at one address under different names are found here, not by
    `robotctl config check`, whose result does not depend on a name server.
    """
    if not links:
        fix = "add a [[mavlink.link]] with an url to the robot's file"
        return [fail("MAVLink", "no link: nobody can arm the robot", fix)]
    listeners: list[_Listener] = []
    return [_check_mavlink_link(link, listeners) for link in links]


def check_key(config: MavlinkConfig) -> Finding:
    """Check that the file with the signing key can be used."""
    # It loads pymavlink.
    from robotctl.app.signing_files import configured_key  # noqa: PLC0415

    check = "MAVLink signing"
    try:
        key = configured_key(config)
    except ConfigError as error:
        fix = "correct the file, or mavlink.signing_key in the robot's file"
        return fail(check, str(error), fix)
    is_missing = f"{config.signing_key} is to come over a safe link"
    return ok(check, is_missing if key is None else config.signing_key)


class _Listener(NamedTuple):
    """Listening address of a link."""

    url: str
    socket_kind: int
    host: str
    port: int

    def clashes(self, other: _Listener) -> bool:
        """Whether the kernel would refuse one of two sockets; port 0 is any free port."""
        if (self.socket_kind, self.port) != (other.socket_kind, other.port) or self.port == 0:
            return False
        hosts = {self.host, other.host}
        same_family = len({":" in host for host in hosts}) == 1
        return len(hosts) == 1 or "::" in hosts or ("0.0.0.0" in hosts and same_family)  # noqa: S104


def _check_mavlink_link(link: LinkConfig, listeners: list[_Listener]) -> Finding:
    """Check one address; a listening link is added to `listeners`, those checked so far."""
    kind, host, port = link.address
    if kind == "serial":
        return ok("MAVLink", f"{link.url}, {port} baud")
    udp = kind.startswith("udp")
    kind_of_socket = socket.SOCK_DGRAM if udp else socket.SOCK_STREAM
    try:
        (family, _, _, _, address), *_ = socket.getaddrinfo(host, port, type=kind_of_socket)
    except (OSError, UnicodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        fix = f"correct {host}, or connect the network that knows it"
        return fail("MAVLink", f"{link.url}: {reason}", fix)
    if kind.endswith("out"):
        return ok("MAVLink", f"{link.url}: sends to {address[0]} port {port}")
    here = _Listener(link.url, kind_of_socket, str(address[0]), port)
    before = next((each for each in listeners if each.clashes(here)), None)
    listeners.append(here)
    if before is not None:
        found = f"{link.url}: {here.host} port {port} is that of {before.url} too"
        return fail("MAVLink", found, "give one of the two links another port, or remove it")
    if (refused := refusal(family, kind_of_socket, address)) is not None:
        fix = (
            "fine if robotctl is running, otherwise see which program has it: "
            f"sudo ss -lnp | grep {port}"
        )
        return warn("MAVLink", f"{link.url}: {refused.strerror}", fix)
    return ok("MAVLink", f"{link.url}: port {port} is free")
