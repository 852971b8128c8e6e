"""`robotctl doctor` as a user calls it, with firmware_sim as the robot."""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotctl.config.robot_file import config_directory, find_file
from robotctl.deploy.check_result import Finding, Verdict
from robotctl.deploy.doctor import check_key, check_mavlink, examine
from robotctl.mavlink.config import MavlinkConfig
from robotctl.messages.mavlink_port import LinkConfig
from robotctl.runtime.ipc.process_lock import claim_bus

DEADLINE_S = 90.0
ROBOTCTL = [sys.executable, "-c", "from robotctl.cli.main import main; main()"]


@pytest.fixture(scope="module")
def channel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run a robot on a simulated bus."""
    folder = tmp_path_factory.mktemp("doctor")
    name, log = str(folder / "hub"), folder / "firmware.log"
    command = [
        *(sys.executable, "-m", "firmware_sim", "--bus", f"simcan:{name}"),
        *("--robot", str(find_file("diff_drive"))),
        *("--world", str(config_directory() / "worlds" / "empty_room.toml")),
        "--start=2,2,0",
    ]
    with log.open("wb") as output, subprocess.Popen(command, stdout=output) as process:
        deadline_s = time.monotonic() + DEADLINE_S
        while "ready" not in log.read_text():
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        yield name
        process.terminate()


def doctor(*arguments: str, robot: str = "diff_drive") -> tuple[int, dict]:
    done = subprocess.run(
        [*ROBOTCTL, "doctor", "--robot", robot, "--json", "--seconds", "0.2", *arguments],
        capture_output=True,
        timeout=DEADLINE_S,
        check=False,
    )
    return done.returncode, json.loads(done.stdout)


def on(channel: str) -> list[str]:
    return ["--set", 'can.interface="simcan"', "--set", f'can.channel="{channel}"']


def by_check(report: dict) -> dict[str, dict]:
    return {each["check"]: each for each in report["findings"]}


def test_a_robot_on_a_simulated_bus_has_all_its_nodes(channel: str, tmp_path: Path) -> None:
    _, report = doctor(*on(channel), "--logs", str(tmp_path))
    found = by_check(report)
    for node in ("node 1 drive", "node 2 sonar", "node 3 power"):
        assert found[node]["verdict"] == "ok", found[node]
        assert "wire version 0x" in found[node]["found"]
    assert found["CAN traffic"]["verdict"] == "ok"
    for check in ("kernel", "real-time rights", "wake-up lag", "write speed", "configuration"):
        assert check in found


def test_the_exit_status_says_whether_something_failed_and_each_failure_has_a_fix(
    channel: str, tmp_path: Path
) -> None:
    status, report = doctor(*on(channel), "--logs", str(tmp_path))
    failed = [each for each in report["findings"] if each["verdict"] == "fail"]
    assert status == (1 if failed else 0)
    assert report["fit"] == (not failed)
    status, report = doctor(*on("no-such-bus"), "--logs", str(tmp_path))
    assert status == 1
    assert not report["fit"]
    found = by_check(report)
    assert found["CAN nodes"]["verdict"] == "fail"
    assert all(each["fix"] for each in report["findings"] if each["verdict"] == "fail")


def test_a_robot_of_another_build_is_told_from_this_one(channel: str, tmp_path: Path) -> None:
    status, report = doctor(
        *on(channel), "--set", "drive.counts_per_revolution=1000", "--logs", str(tmp_path)
    )
    finding = by_check(report)["node 1 drive"]
    assert status == 1
    assert finding["verdict"] == "fail"
    assert "2400" in finding["found"]
    assert "1000" in finding["found"]
    assert "robot's file" in finding["fix"]


def test_a_wrong_configuration_is_the_first_and_only_finding(tmp_path: Path) -> None:
    robot = tmp_path / "mine.toml"
    robot.write_text(find_file("diff_drive").read_text().replace("kp =", "kpp =", 1))
    status, report = doctor(robot=str(robot))
    assert status == 1
    (finding,) = report["findings"]
    assert "kpp" in finding["found"]


def test_where_a_controller_is_running_doctor_only_listens(
    channel: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    environment = os.environ | {"XDG_RUNTIME_DIR": str(tmp_path_factory.mktemp("run"))}
    command = [*ROBOTCTL, "run", *on(channel), "--set", "mavlink.link=[]"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(b"ready:"):
                break
        try:
            _, report = doctor(*on(channel), "--logs", str(tmp_path))
        finally:
            process.terminate()
            process.communicate(timeout=DEADLINE_S)
    found = by_check(report)
    assert "a controller is running" in found["CAN nodes"]["found"]
    assert "drive, sonar, power" in found["CAN nodes"]["found"]
    assert " 0 sent" in found["CAN traffic"]["found"]


def test_where_a_controller_has_the_bus_and_waits_for_its_restart_doctor_only_listens(
    channel: str, tmp_path: Path
) -> None:
    with claim_bus("simcan", channel):
        found = by_check(doctor(*on(channel), "--logs", str(tmp_path))[1])
    assert "a controller is running" in found["CAN nodes"]["found"]
    assert " 0 sent" in found["CAN traffic"]["found"]


def test_a_signing_key_is_read_as_telemetry_will(tmp_path: Path) -> None:
    path = tmp_path / "mavlink.key"
    config = MavlinkConfig(signing_key=str(path))
    assert "keygen" in check_key(config).found
    coming = LinkConfig("serial:/dev/ttyS0:57600", safe=True)
    assert "is to come" in check_key(MavlinkConfig(link=(coming,), signing_key=str(path))).found
    path.write_text("short\n")
    path.chmod(0o600)
    short = check_key(config)
    assert short.verdict is Verdict.FAIL
    assert "5 characters" in short.found
    path.write_text("long enough\n")
    assert check_key(config) == Finding("MAVLink signing", Verdict.OK, str(path), "")


def test_mavlink_addresses_are_resolved_and_tried() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        links = (
            LinkConfig("udpout:127.0.0.1:14550"),
            LinkConfig(f"tcpin:127.0.0.1:{port}"),
            LinkConfig("udpout:no-such-host.invalid:14550"),
            LinkConfig("serial:/dev/ttyUSB0:57600"),
        )
        findings = check_mavlink(links)
    verdicts = [each.verdict for each in findings]
    assert verdicts == [Verdict.OK, Verdict.WARN, Verdict.FAIL, Verdict.OK]
    (nobody,) = check_mavlink(())
    assert nobody.verdict is Verdict.FAIL


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("tcpin:127.0.0.1", "tcpin:localhost"),
        ("tcpin:0.0.0.0", "tcpin:127.0.0.1"),
        ("udpin:127.0.0.1", "udpin:127.1"),
        ("tcpin:[::]", "tcpin:127.0.0.1"),
    ],
)
def test_two_links_that_listen_at_one_address_are_told(first: str, second: str) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    one, other = check_mavlink((LinkConfig(f"{first}:{port}"), LinkConfig(f"{second}:{port}")))
    assert one.verdict is not Verdict.FAIL
    assert other.verdict is Verdict.FAIL
    assert f"{first}:{port}" in other.found
    assert "another port" in other.fix


def test_links_that_listen_apart_are_no_clash() -> None:
    urls = ("tcpin:127.0.0.1:0", "tcpin:localhost:0", "udpin:127.0.0.1:0", "udpout:127.0.0.1:9")
    findings = check_mavlink(tuple(LinkConfig(url) for url in urls))
    assert [each.verdict for each in findings] == [Verdict.OK] * 4


def test_a_map_that_is_not_there_is_found_before_the_robot_drives(tmp_path: Path) -> None:
    def second(*settings: str) -> Finding:
        findings = examine(find_file("diff_drive"), settings, tmp_path)
        next(findings)
        return next(findings)

    missing = second('localisation.map="nowhere.yaml"')
    assert (missing.check, missing.verdict) == ("map and places", Verdict.FAIL)
    assert "localisation.map: nowhere.yaml: no such file" in missing.found
    assert "config check" in missing.fix
    there = second('localisation.map="flat"')
    assert (there.verdict, there.found) == (Verdict.OK, "flat")
