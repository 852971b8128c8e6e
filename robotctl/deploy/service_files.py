"""The files of a deployed robot that `robotctl install` writes, made from `configs/systemd/`."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotctl.app.processes.navigator import abilities, load_mission
from robotctl.config.robot_file import config_directory, load_robot
from robotctl.deploy.doctor_can import QUEUE_FRAMES
from robotctl.drivers.can.config import RESTART_MS, CanConfig
from robotctl.errors import ConfigError
from robotctl.planning.behave.mission.check import check_mission

UNIT: Final = Path("etc/systemd/system/robotctl.service")
ROBOT: Final = Path("etc/robotctl/robot.toml")
MISSION: Final = Path("etc/robotctl/mission.toml")

_TARGETS: Final = {
    "robotctl.service": UNIT,
    "robotctl.rules": Path("etc/udev/rules.d/70-robotctl.rules"),
    "robotctl.sysusers": Path("etc/sysusers.d/robotctl.conf"),
}
_NETWORK: Final = Path("etc/systemd/network")
_CAN_FD: Final = "\nDataBitRate=@DATA_BITRATE@\nDataSamplePoint=@DATA_SAMPLE_POINT@\nFDMode=yes"
_PLACEHOLDER = re.compile(r"@([A-Z_]+)@")
_OTHERS_MAY_ENTER = 0o001
_OTHERS_MAY_RUN = 0o005
_NOT_IN_A_UNIT: Final = re.compile(r"[\"'\\\x00-\x1f\x7f]")
"""Characters that systemd refuses in a program's path, however quoted."""


@dataclass(frozen=True, slots=True)
class ServiceFile:
    """One file to install.

    Parameters
    ----------
    path
        Path relative to the root.
    data
        Content.
    """

    path: Path
    data: bytes

    @property
    def text(self) -> str:
        """Content as text; for an image only its size."""
        try:
            return self.data.decode()
        except UnicodeDecodeError:
            return f"({len(self.data)} bytes, binary)"


def service_files(
    robot: Path, mission: Path | None, executable: Path, processors: int
) -> list[ServiceFile]:
    """Return all files of one deployed robot.

    Parameters
    ----------
    robot, mission
        Configuration and mission; both are checked, and copied to /etc/robotctl, together with the
        map and the places that the configuration names by relative paths.
    executable
        The program `robotctl` that the service starts; absolute.
    processors
        Number of processors of the robot's computer.

    Raises
    ------
    ConfigError
        If one of them is invalid, or the robot has no SocketCAN bus.
    MissionError
        If the robot cannot drive the mission.
    """
    # It loads numba.
    from robotctl.app.localisation.localisation_files import files_beside  # noqa: PLC0415

    config = load_robot(robot)
    for bus in config.buses:
        if bus.interface != "socketcan":
            raise ConfigError(
                f'{robot}: can.interface is "{bus.interface}"; an installed robot needs "socketcan"'
            )
    if mission is not None:
        check_mission(load_mission(mission), abilities(config, robot))
    beside = {ROBOT.parent / name: data for name, data in files_beside(config, robot).items()}
    if taken := beside.keys() & {ROBOT, MISSION}:
        raise ConfigError(f"{robot}: the name {min(taken).name} is taken in /{ROBOT.parent}")
    values = {
        "NAME": config.robot.name,
        "ROBOTCTL": _quoted(executable),
        "MISSION": f" --mission /{MISSION}" if mission is not None else "",
        "DEVICES": " ".join(
            f"sys-subsystem-net-devices-{unit_name(bus.channel)}.device" for bus in config.buses
        ),
        "AFFINITY": affinity(config.runtime.cpu, processors),
    }
    files = [_filled(name, target, values) for name, target in _TARGETS.items()]
    for number, bus in enumerate(config.buses):
        files += network_files(bus, f"-{bus.name}" if number else "")
    files.append(ServiceFile(ROBOT, robot.read_bytes()))
    if mission is not None:
        files.append(ServiceFile(MISSION, mission.read_bytes()))
    return files + [ServiceFile(path, data) for path, data in beside.items()]


def network_files(bus: CanConfig, suffix: str) -> list[ServiceFile]:
    """Return the systemd-networkd files of a bus; their names end in `suffix`."""
    point, data_point = bus.sample_points
    values = {
        "CHANNEL": bus.channel,
        "BITRATE": str(bus.bitrate),
        "SAMPLE_POINT": f"{100 * point:g}%",
        "DATA_BITRATE": str(bus.data_bitrate),
        "DATA_SAMPLE_POINT": f"{100 * data_point:g}%",
        "RESTART_MS": str(RESTART_MS),
        "QUEUE": str(QUEUE_FRAMES),
    }
    values["CAN_FD"] = fill(_CAN_FD, values) if bus.data_bitrate else ""
    return [
        _filled(f"can.{kind}", _NETWORK / f"70-robotctl-can{suffix}.{kind}", values)
        for kind in ("network", "link")
    ]


def _filled(name: str, target: Path, values: dict[str, str]) -> ServiceFile:
    """Return a file made from a template of `configs/systemd/`."""
    template = (config_directory() / "systemd" / name).read_text(encoding="utf-8")
    return ServiceFile(target, fill(template, values).encode())


def fill(template: str, values: dict[str, str]) -> str:
    """Replace each `@NAME@`.

    Raises
    ------
    KeyError
        If a name has no value.
    """
    return _PLACEHOLDER.sub(lambda match: values[match[1]], template)


def unit_name(device: str) -> str:
    """Return the unit name of a device, escaped like by systemd-escape."""
    return "".join(
        each if (each.isascii() and each.isalnum()) or each in ":_." else f"\\x{ord(each):02x}"
        for each in device
    )


def affinity(cpu: int, processors: int) -> str:
    """Return the line that keeps all but the control loop off its processor `runtime.cpu`.

    The control process moves itself to that processor.
    """
    others = [str(each) for each in range(processors) if each != cpu]
    if cpu < 0 or not others:
        return "# No CPUAffinity: runtime.cpu gives the control loop no processor of its own."
    return f"CPUAffinity={' '.join(others)}"


def check_executable(path: Path) -> None:
    """Check that the service's user can reach and start the program.

    Raises
    ------
    ConfigError
        If it is missing, it or one of its parent folders is closed to others, or systemd cannot
        start a program of that name.
    """
    if not os.access(path, os.X_OK):
        raise ConfigError(f"{path}: no such program; install the package robotctl there")
    if _NOT_IN_A_UNIT.search(str(path)):
        raise ConfigError(
            f"{str(path)!r}: systemd cannot start a program whose path has quotes, backslashes or "
            "control characters; install robotctl into a folder such as /opt/robotctl"
        )
    target = path.resolve()
    if target.stat().st_mode & _OTHERS_MAY_RUN != _OTHERS_MAY_RUN:
        raise ConfigError(f"{path}: the user robotctl may not run it; chmod a+rx {target}")
    for folder in {*path.parents, *target.parents}:
        if not folder.stat().st_mode & _OTHERS_MAY_ENTER:
            raise ConfigError(
                f"{path}: the user robotctl cannot enter {folder}; install robotctl into a folder "
                "that all users can enter, such as /opt/robotctl"
            )


def _quoted(path: Path) -> str:
    """Return a path for ExecStart=."""
    text = str(path).replace("%", "%%")
    return text if re.fullmatch(r"[\w./%+-]+", text) else f'"{text}"'
