"""`robotctl can` on a simulated bus of its own process, and what it prints."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotctl.cli.can_scan import print_reports
from robotctl.cli.console import plain_console
from robotctl.config.robot_file import config_directory, find_file
from robotctl.runtime.ipc.process_lock import claim_bus
from tests.cli.command import status_of
from tests.drivers.can.drives.scan_bench import ScanBench


@pytest.fixture(scope="module")
def channel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run a robot with two ODrives on a simulated bus."""
    name = str(tmp_path_factory.mktemp("scan") / "hub")
    command = [
        *(sys.executable, "-m", "firmware_sim", "--bus", f"simcan:{name}"),
        *("--robot", str(find_file("odrive"))),
        *("--world", str(config_directory() / "worlds" / "empty_room.toml")),
        "--start=2,2,0",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert any("ready" in line for line in process.stdout)
        yield name
        process.terminate()


def scan(channel: str, *arguments: str) -> int:
    """Scan the bus as `robotctl can scan` does."""
    return status_of("can", "scan", "--interface", "simcan", "--channel", channel, *arguments)


def test_the_drives_of_a_simulated_robot_are_found(
    channel: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert scan(channel, "--json") == 0
    ((each),) = json.loads(capsys.readouterr().out)
    report = each["report"]
    assert each["bus"]["channel"] == channel
    found = {(found["protocol"], found["number"]) for found in report["found"]}
    assert found == {("ODrive", 33), ("ODrive", 34), ("robotctl", 2)}
    assert report["verdict"] == "found"
    assert report["duration_ms"] < 3000.0


def test_a_bus_that_another_process_drives_is_only_listened_to(
    channel: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with claim_bus("simcan", channel):
        assert scan(channel) == 0
    assert "a controller is running" in capsys.readouterr().out


def test_the_robots_file_names_bus_and_wheels(
    channel: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    settings = ["--set", 'can.interface="simcan"', "--set", f'can.channel="{channel}"']
    assert status_of("can", "scan", "--robot", "odrive", *settings) == 0
    printed = capsys.readouterr().out
    tables = tomllib.loads(printed[printed.index("# ODrive 33") :])["motor"]
    assert [(each["node_id"], each["axes"][0]["actuator"]) for each in tables] == [
        (33, "left"),
        (34, "right"),
    ]


def test_an_empty_bus_ends_with_status_1_and_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = str(tmp_path / "bus")
    command = [sys.executable, "-m", "firmware_sim.bus", "--channel", name]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        process.stderr.readline()
        assert scan(name) == 1
        process.terminate()
    printed = capsys.readouterr().out
    assert "nobody acknowledges" in printed
    assert "120 ohm" in " ".join(printed.split())


def test_a_bit_rate_that_there_is_not_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("can", "scan", "--bitrate", "123456") == 2
    assert "--bitrate: must be one of" in capsys.readouterr().err


def test_a_table_of_all_kinds_fits_into_80_columns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    bench = ScanBench(native=True, data_bitrate=5_000_000)
    for kind, number, keys in (
        ("odrive", 33, {}),
        ("vesc", 10, {}),
        ("moteus", 1, {}),
        ("cia402", 20, {"dialect": "zlac8015d"}),
    ):
        bench.add(kind, number, **keys)
    reports = [(bench.config, bench.scan())]
    print_reports(plain_console(), reports, ("left", "right", "rear_left"))
    printed = capsys.readouterr().out
    table, tables = printed.split("For the robot's file")
    assert all(len(line) <= 80 for line in table.splitlines())
    for word in ("ODrive", "VESC", "moteus", "CiA 402", "robotctl", "0.6.10", "6.05", "sonar"):
        assert word in table
    motors = tomllib.loads(tables[tables.index("#") :])["motor"]
    assert [motor["kind"] for motor in motors] == ["native", "cia402", "odrive", "vesc", "moteus"]


@pytest.mark.parametrize("robot", ["diff_drive", "odrive", "skid_steer", "zlac8015d", "vesc_car"])
def test_the_budget_of_a_robot_has_the_frames_of_its_own_drives(
    robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of("can", "budget", "--robot", robot) == 0
    printed = capsys.readouterr().out
    assert ("MotorCommand" in printed) == (robot == "diff_drive")
    assert printed.count("command") >= (0 if robot == "diff_drive" else 1)
