"""Installing into a folder that stands for a computer, and taking it back."""

import configparser
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.config.robot_file import find_file
from robotctl.deploy.install import MANIFEST, conflicts, install, read_manifest, uninstall
from robotctl.deploy.service_files import (
    MISSION,
    ROBOT,
    UNIT,
    ServiceFile,
    affinity,
    check_executable,
    fill,
    service_files,
    unit_name,
)
from robotctl.errors import ConfigError

ROBOTS = ("diff_drive", "tricycle", "ackermann")


@pytest.fixture(scope="module")
def program() -> Path:
    """Return a program that stands for robotctl and that all may run."""
    return Path(shutil.which("true") or "/bin/true")


def robot_file(folder: Path, **changes: str) -> Path:
    """Write a robot's file with some texts of the shipped one replaced."""
    text = find_file("diff_drive").read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def tree(root: Path) -> dict[str, str | None]:
    """Return all folders (None) and files (their text) below `root`."""
    return {
        str(path.relative_to(root)): path.read_text() if path.is_file() else None
        for path in sorted(root.rglob("*"))
    }


def sections(text: str) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=True, interpolation=None, delimiters=("=",))
    parser.optionxform = str  # type: ignore[assignment]
    parser.read_string(text)
    return parser


def text_of(files: list[ServiceFile], name: str) -> str:
    (text,) = (file.text for file in files if file.path.name == name)
    return text


@pytest.fixture
def files(program: Path) -> list[ServiceFile]:
    return service_files(find_file("diff_drive"), find_file("patrol", "missions"), program, 4)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("mission", ["", "patrol"])
def test_every_file_is_filled_and_the_unit_starts_exactly_what_is_installed(
    robot: str, mission: str, program: Path
) -> None:
    files = service_files(
        find_file(robot), find_file(mission, "missions") if mission else None, program, 4
    )
    assert not [file.path for file in files if "@" in file.text]
    service = sections(text_of(files, "robotctl.service"))["Service"]
    words = service["ExecStart"].split()
    assert words[:4] == ["/usr/bin/env", "--block-signal=USR1", str(program), "run"]
    assert words[words.index("--robot") + 1] == f"/{ROBOT}"
    assert ("--mission" in words) == bool(mission) == (MISSION in [f.path for f in files])
    assert text_of(files, ROBOT.name) == find_file(robot).read_text()


def test_the_unit_asks_for_what_real_time_needs_and_forbids_nothing_of_it(
    files: list[ServiceFile],
) -> None:
    unit = sections(text_of(files, "robotctl.service"))
    service = unit["Service"]
    assert service["Type"] == "notify"
    assert service["NotifyAccess"] == "main"
    assert float(service["WatchdogSec"]) > 0
    assert service["LimitMEMLOCK"] == "infinity"
    assert int(service["LimitRTPRIO"]) == 99
    assert set(service["AmbientCapabilities"].split()) == {"CAP_SYS_NICE", "CAP_IPC_LOCK"}
    assert set(service["CapabilityBoundingSet"].split()) >= {"CAP_SYS_NICE", "CAP_IPC_LOCK"}
    assert service["OOMPolicy"] == "continue"
    assert "AF_CAN" in service["RestrictAddressFamilies"].split()
    forbidden = {
        "RestrictRealtime", "PrivateDevices", "ProtectClock", "DevicePolicy", "PrivateNetwork",
        "MemoryDenyWriteExecute", "SystemCallFilter", "PrivateUsers",
    }  # fmt: skip
    assert not forbidden & set(service)
    assert unit["Unit"]["BindsTo"] == "sys-subsystem-net-devices-can0.device"
    assert unit["Unit"]["BindsTo"] in unit["Unit"]["After"].split()
    assert unit["Install"]["WantedBy"] == unit["Unit"]["BindsTo"]


def test_the_can_link_is_that_of_the_robots_file(tmp_path: Path, program: Path) -> None:
    robot = robot_file(tmp_path, **{'"can0"': '"can1"', "1_000_000": "500_000"})
    files = service_files(robot, None, program, 4)
    network = sections(text_of(files, "70-robotctl-can.network"))
    assert network["Match"]["Name"] == "can1"
    assert network["CAN"]["BitRate"] == "500000"
    assert network["CAN"]["SamplePoint"] == "87.5%"
    assert network["CAN"]["RestartSec"] == "100ms"
    link = sections(text_of(files, "70-robotctl-can.link"))
    assert link["Match"]["OriginalName"] == "can1"
    assert link["Link"]["TransmitQueueLength"] == "16"
    unit = sections(text_of(files, "robotctl.service"))
    assert unit["Unit"]["BindsTo"] == "sys-subsystem-net-devices-can1.device"


def test_a_link_of_can_fd_has_its_data_bit_rate(tmp_path: Path, program: Path) -> None:
    fd = "1_000_000\ndata_bitrate = 5_000_000\nsample_point = 0.6375\ndata_sample_point = 0.5625"
    robot = robot_file(tmp_path, **{"1_000_000": fd})
    network = sections(text_of(service_files(robot, None, program, 4), "70-robotctl-can.network"))
    assert dict(network["CAN"]) == {
        "BitRate": "1000000",
        "SamplePoint": "63.75%",
        "DataBitRate": "5000000",
        "DataSamplePoint": "56.25%",
        "FDMode": "yes",
        "RestartSec": "100ms",
    }


def test_each_bus_has_its_link_and_the_service_is_bound_to_all(
    tmp_path: Path, program: Path
) -> None:
    two = '[[can]]\nchannel = "can-1"\n\n[[can]]\nname = "sensors"\n'
    robot = robot_file(tmp_path, **{"[can]\n": two})
    files = service_files(robot, None, program, 4)
    first = sections(text_of(files, "70-robotctl-can.network"))
    second = sections(text_of(files, "70-robotctl-can-sensors.network"))
    assert (first["Match"]["Name"], second["Match"]["Name"]) == ("can-1", "can0")
    assert (
        sections(text_of(files, "70-robotctl-can-sensors.link"))["Match"]["OriginalName"] == "can0"
    )
    unit = sections(text_of(files, "robotctl.service"))
    devices = [rf"sys-subsystem-net-devices-{each}.device" for each in (r"can\x2d1", "can0")]
    assert unit["Unit"]["BindsTo"].split() == devices
    assert unit["Install"]["WantedBy"].split() == devices
    assert set(devices) <= set(unit["Unit"]["After"].split())
    assert len({each.path for each in files}) == len(files)


def test_the_control_loops_processor_is_kept_free_of_the_others(
    tmp_path: Path, program: Path
) -> None:
    robot = robot_file(tmp_path, **{"rate_hz = 200": "rate_hz = 200\ncpu = 3"})
    text = text_of(service_files(robot, None, program, 4), "robotctl.service")
    assert sections(text)["Service"]["CPUAffinity"] == "0 1 2"
    assert affinity(-1, 4).startswith("#")
    assert affinity(0, 1).startswith("#")


def test_the_unit_sets_the_governor_at_each_start_and_starts_where_there_is_none(
    files: list[ServiceFile], tmp_path: Path
) -> None:
    start = sections(text_of(files, "robotctl.service"))["Service"]["ExecStartPre"]
    assert start.startswith("-+/bin/sh -c ")
    _, _, script = shlex.split(start.replace("$$", "$"))
    for cpu in ("cpu0", "cpu1"):
        (tmp_path / cpu / "cpufreq").mkdir(parents=True)
        (tmp_path / cpu / "cpufreq" / "scaling_governor").write_text("ondemand\n")
    for folder in (tmp_path, tmp_path / "none"):
        here = script.replace("/sys/devices/system/cpu", str(folder))
        done = subprocess.run(["/bin/sh", "-c", here], capture_output=True, check=False)
        assert done.stderr == b""
    governors = [path.read_text() for path in tmp_path.glob("cpu*/cpufreq/scaling_governor")]
    assert governors == ["performance\n"] * 2


def test_a_simulated_bus_or_a_wrong_file_is_not_installed(tmp_path: Path, program: Path) -> None:
    with pytest.raises(ConfigError, match="socketcan"):
        service_files(robot_file(tmp_path, **{'"socketcan"': '"simcan"'}), None, program, 4)
    with pytest.raises(ConfigError, match="kpp"):
        service_files(robot_file(tmp_path, **{"kp =": "kpp ="}), None, program, 4)
    with pytest.raises(ConfigError):
        service_files(find_file("diff_drive"), find_file("diff_drive"), program, 4)


def test_names_of_device_units_are_escaped() -> None:
    assert unit_name("can0") == "can0"
    assert unit_name("slcan-0") == "slcan\\x2d0"


def test_a_template_with_an_unknown_name_is_refused() -> None:
    with pytest.raises(KeyError):
        fill("@NAME@ @OTHER@", {"NAME": "x"})


def test_a_program_that_the_service_could_not_start_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such program"):
        check_executable(tmp_path / "robotctl")
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700)
    hidden = closed / "robotctl"
    hidden.write_text("")
    hidden.chmod(0o755)
    with pytest.raises(ConfigError, match="/opt/robotctl"):
        check_executable(hidden)
    mine = tmp_path / "mine"
    mine.write_text("")
    mine.chmod(0o744)
    with pytest.raises(ConfigError, match=rf"chmod a\+rx {mine}"):
        check_executable(mine)
    odd = tmp_path / 'a"b'
    shutil.copy("/bin/true", odd)
    with pytest.raises(ConfigError, match="quotes"):
        check_executable(odd)


def test_uninstalling_leaves_a_computer_exactly_as_it_was(
    tmp_path: Path, files: list[ServiceFile]
) -> None:
    (tmp_path / "etc" / "systemd" / "system").mkdir(parents=True)
    (tmp_path / "etc" / "hosts").write_text("localhost\n")
    before = tree(tmp_path)
    lines = install(files, tmp_path)
    assert len(lines) == len(files)
    assert set(tree(tmp_path)) > set(before)
    for file in files:
        assert (tmp_path / file.path).read_text() == file.text
        assert (tmp_path / file.path).stat().st_mode & 0o777 == 0o644
    _, kept = uninstall(tmp_path)
    assert kept == []
    assert tree(tmp_path) == before
    with pytest.raises(ConfigError, match="nothing is installed"):
        uninstall(tmp_path)


def test_folders_are_open_to_all_whatever_the_umask(
    tmp_path: Path, files: list[ServiceFile]
) -> None:
    before = os.umask(0o077)
    try:
        install(files, tmp_path / "image")
    finally:
        os.umask(before)
    modes = {path: path.stat().st_mode & 0o777 for path in (tmp_path / "image").rglob("*")}
    assert {mode for path, mode in modes.items() if path.is_dir()} == {0o755}
    assert {mode for path, mode in modes.items() if path.is_file()} == {0o644}
    assert (tmp_path / "image").stat().st_mode & 0o777 == 0o755


def test_installing_twice_changes_nothing(tmp_path: Path, files: list[ServiceFile]) -> None:
    install(files, tmp_path)
    before = tree(tmp_path)
    lines = install(files, tmp_path)
    assert len(lines) == len(files)
    assert all(line.startswith("same") for line in lines)
    assert tree(tmp_path) == before


def test_a_changed_file_is_kept_and_said_and_can_be_removed_once_it_is_as_it_was(
    tmp_path: Path, files: list[ServiceFile]
) -> None:
    install(files, tmp_path)
    robot = tmp_path / ROBOT
    original = robot.read_text()
    robot.write_text(original + "# tuned on the robot\n")
    _, kept = uninstall(tmp_path)
    assert len(kept) == 1
    assert str(robot) in kept[0]
    assert [path for path, text in tree(tmp_path).items() if text is not None] == [
        str(MANIFEST),
        str(ROBOT),
    ]
    robot.write_text(original)
    assert uninstall(tmp_path)[1] == []
    assert tree(tmp_path) == {}


def test_nothing_is_written_where_somebody_elses_file_is_in_the_way(
    tmp_path: Path, files: list[ServiceFile]
) -> None:
    unit = tmp_path / UNIT
    unit.parent.mkdir(parents=True)
    unit.write_text("[Service]\n")
    before = tree(tmp_path)
    assert len(conflicts(files, tmp_path)) == 1
    with pytest.raises(ConfigError, match="not installed by robotctl"):
        install(files, tmp_path)
    assert tree(tmp_path) == before


def test_a_file_changed_on_the_robot_is_not_overwritten_by_an_upgrade(
    tmp_path: Path, files: list[ServiceFile]
) -> None:
    install(files, tmp_path)
    (tmp_path / ROBOT).write_text("mine")
    newer = [ServiceFile(file.path, file.data + b"# newer\n") for file in files]
    with pytest.raises(ConfigError, match="changed since"):
        install(newer, tmp_path)
    assert (tmp_path / ROBOT).read_text() == "mine"
    assert (tmp_path / UNIT).read_text() == text_of(files, UNIT.name)


def test_an_upgrade_replaces_unchanged_files_and_removes_what_it_no_longer_needs(
    tmp_path: Path, files: list[ServiceFile]
) -> None:
    install(files, tmp_path)
    newer = [
        ServiceFile(file.path, file.data + b"# newer\n") for file in files if file.path != MISSION
    ]
    lines = install(newer, tmp_path)
    assert sum(line.startswith("replaced") for line in lines) == len(newer)
    assert not (tmp_path / MISSION).exists()
    assert str(MISSION) not in read_manifest(tmp_path).files
    assert uninstall(tmp_path)[1] == []
    assert tree(tmp_path) == {}


def test_an_installation_that_was_cut_short_can_be_taken_back(
    tmp_path: Path, files: list[ServiceFile], monkeypatch: pytest.MonkeyPatch
) -> None:
    real, left = Path.replace, [3]

    def replace(self: Path, target: Path) -> Path:
        left[0] -= 1
        if left[0] == 0:
            raise OSError(28, "No space left on device", str(target))
        return real(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(ConfigError, match="No space left"):
        install(files, tmp_path)
    monkeypatch.undo()
    assert uninstall(tmp_path)[1] == []
    assert [path for path, text in tree(tmp_path).items() if text is not None] == []


def test_a_damaged_manifest_is_said(tmp_path: Path, files: list[ServiceFile]) -> None:
    install(files, tmp_path)
    (tmp_path / MANIFEST).write_text("{")
    for act in (lambda: install(files, tmp_path), lambda: uninstall(tmp_path)):
        with pytest.raises(ConfigError, match=r"installed\.json"):
            act()


def test_a_dry_run_shows_every_file_and_writes_none(tmp_path: Path) -> None:
    program = "from robotctl.cli.main import main; main()"
    command = [sys.executable, "-c", program, "install", "--dry-run", "--root", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert list(tmp_path.iterdir()) == []
    for file in service_files(find_file("diff_drive"), None, Path("/bin/true"), 4):
        assert f"### {tmp_path / file.path}\n" in done.stdout
    # An interpreter that the service could not start is shown last; elsewhere all is well.
    assert done.returncode == 0 or "install robotctl into a folder" in done.stderr


def run_install(root: Path, *arguments: str) -> str:
    """Run `robotctl install` below `root` and return what it prints."""
    done = CliRunner().invoke(app, ["install", "--root", str(root), *arguments])
    assert done.exit_code == 0, (done.output, done.exception)
    return done.output


@pytest.fixture
def reachable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the service's user reach robotctl wherever the tests run."""
    monkeypatch.setattr("robotctl.cli.install.check_executable", lambda _path: None)


@pytest.mark.usefixtures("reachable")
def test_the_documented_update_keeps_the_mission_until_it_is_told_not_to(tmp_path: Path) -> None:
    run_install(tmp_path, "--mission", "patrol")
    before = tree(tmp_path)
    update = ("--robot", str(tmp_path / ROBOT))
    assert f"mission kept: {tmp_path / MISSION}" in run_install(tmp_path, *update)
    assert tree(tmp_path) == before
    assert f"removed  {tmp_path / MISSION}" in run_install(tmp_path, *update, "--no-mission")
    assert not (tmp_path / MISSION).exists()
    assert "--mission" not in (tmp_path / UNIT).read_text()
    assert "mission kept" not in run_install(tmp_path, *update)


@pytest.mark.usefixtures("reachable")
def test_the_links_set_up_takes_effect_at_once_and_starts_no_networkd(tmp_path: Path) -> None:
    robot = robot_file(tmp_path, **{'"can0"': '"can1"'})
    printed = run_install(tmp_path / "root", "--robot", str(robot))
    commands = [
        line.split(": ", 1)[1] for line in printed.splitlines() if "run on the robot" in line
    ]
    again = "udevadm trigger --action=add --subsystem-match=net --sysname-match=can1"
    networkd = "systemctl try-restart systemd-networkd"
    assert commands.index("udevadm control --reload") < commands.index(again)
    assert commands.index(again) < commands.index(networkd)
    done = CliRunner().invoke(app, ["uninstall", "--root", str(tmp_path / "root")])
    assert networkd in done.output


@pytest.mark.usefixtures("reachable")
def test_a_dry_run_of_uninstall_shows_all_and_removes_nothing(tmp_path: Path) -> None:
    run_install(tmp_path, "--mission", "patrol")
    (tmp_path / UNIT).write_text("changed")
    before = tree(tmp_path)
    dry = CliRunner().invoke(app, ["uninstall", "--dry-run", "--root", str(tmp_path)])
    assert tree(tmp_path) == before
    real = CliRunner().invoke(app, ["uninstall", "--root", str(tmp_path)])
    assert dry.exit_code == real.exit_code == 1
    assert dry.output.replace("to be removed  ", "removed  ") == real.output
    assert f"to be removed  {tmp_path / MISSION}" in dry.output
    assert f"kept because it was changed: {tmp_path / UNIT}" in dry.output


@pytest.mark.usefixtures("reachable")
def test_an_update_takes_a_mission_that_was_changed_on_the_robot(tmp_path: Path) -> None:
    run_install(tmp_path, "--mission", "patrol")
    mission = tmp_path / MISSION
    mission.write_text(mission.read_text() + "# changed on the robot\n")
    run_install(tmp_path, "--robot", str(tmp_path / ROBOT))
    assert mission.read_text().endswith("# changed on the robot\n")
    assert f"--mission /{MISSION}" in (tmp_path / UNIT).read_text()


@pytest.mark.usefixtures("reachable")
def test_what_was_changed_on_the_robot_outlives_an_update_and_uninstalling(tmp_path: Path) -> None:
    run_install(tmp_path, "--mission", "patrol")
    robot, mission = tmp_path / ROBOT, tmp_path / MISSION
    for file in (robot, mission):
        file.write_text(file.read_text() + "# changed on the robot\n")
    run_install(tmp_path, "--robot", str(robot))
    refused = CliRunner().invoke(app, ["install", "--root", str(tmp_path), "--no-mission"])
    assert isinstance(refused.exception, ConfigError)
    done = CliRunner().invoke(app, ["uninstall", "--root", str(tmp_path)])
    assert done.output.count("kept because it was changed") == 2
    for file in (robot, mission):
        assert file.read_text().endswith("# changed on the robot\n")


def test_a_mission_and_none_cannot_be_asked_for_at_once(tmp_path: Path) -> None:
    arguments = ["install", "--root", str(tmp_path), "--mission", "patrol", "--no-mission"]
    done = CliRunner().invoke(app, arguments)
    assert isinstance(done.exception, ConfigError)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize(("cpu", "folder"), [(-1, "robotctl"), (1, "my robot at 100%")])
def test_systemd_accepts_the_unit(
    tmp_path: Path, program: Path, robot: str, cpu: int, folder: str
) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not installed: the unit was not verified")
    text = find_file(robot).read_text().replace("[runtime]\n", f"[runtime]\ncpu = {cpu}\n")
    mine = tmp_path / "mine.toml"
    mine.write_text(text)
    (tmp_path / folder).mkdir()
    mine_too = shutil.copy(program, tmp_path / folder / "robotctl")
    install(service_files(mine, None, Path(mine_too), 4), tmp_path)
    done = subprocess.run(
        [analyze, "verify", str(tmp_path / UNIT)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"SYSTEMD_LOG_LEVEL": "info"},
    )
    ours = [line for line in (done.stdout + done.stderr).splitlines() if "robotctl" in line]
    assert ours == []
    assert done.returncode == 0
