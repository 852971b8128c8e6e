"""Checks of the CAN link on what `ip` prints for such links."""

import copy
import subprocess

import can
import pytest

from robotctl.deploy import doctor_can
from robotctl.deploy.check_result import Finding, Verdict
from robotctl.deploy.doctor_can import check_link, read_link
from robotctl.drivers.can.config import CanConfig, recommended_sample_point

CONFIG = CanConfig()
CAN0 = {
    "ifname": "can0",
    "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
    "txqlen": 16,
    "linkinfo": {
        "info_kind": "can",
        "info_data": {
            "state": "ERROR-ACTIVE",
            "berr_counter": {"tx": 0, "rx": 0},
            "restart_ms": 100,
            "bittiming": {"bitrate": 1000000, "sample_point": "0.750"},
        },
        "info_xstats": {"bus_error": 0, "bus_off": 0},
    },
}


def findings(**changes: object) -> dict[str, Finding]:
    """Return the findings of a good link with changes below `linkinfo.info_data`, or above."""
    link: dict = copy.deepcopy(CAN0)
    for key, value in changes.items():
        (link if key in link else link["linkinfo"]["info_data"])[key] = value
    return {each.check: each for each in check_link(CONFIG, link)}


def test_a_good_link_has_nothing_to_mend() -> None:
    found = findings()
    assert {each.verdict for each in found.values()} == {Verdict.OK}
    assert set(found) == {"CAN link", "CAN bit rate", "CAN errors", "CAN restart-ms", "CAN queue"}


@pytest.mark.parametrize(
    ("change", "check", "verdict", "words"),
    [
        ({"flags": ["NOARP"]}, "CAN link", Verdict.FAIL, "sudo ip link set can0 up type can"),
        (
            {"bittiming": {"bitrate": 500000, "sample_point": "0.875"}},
            "CAN bit rate", Verdict.FAIL, "500000 bit/s",
        ),
        (
            {"bittiming": {"bitrate": 1000000, "sample_point": "0.875"}},
            "CAN bit rate", Verdict.WARN, "recommended 75.0%",
        ),
        ({"restart_ms": 0}, "CAN restart-ms", Verdict.FAIL, "restart-ms 100"),
        ({"state": "BUS-OFF"}, "CAN errors", Verdict.FAIL, "bus-off"),
        ({"state": "ERROR-PASSIVE"}, "CAN errors", Verdict.FAIL, "acknowledges"),
        ({"state": "ERROR-WARNING"}, "CAN errors", Verdict.WARN, "termination"),
        ({"berr_counter": {"tx": 3, "rx": 0}}, "CAN errors", Verdict.WARN, "tx 3"),
        ({"state": "STOPPED"}, "CAN errors", Verdict.FAIL, "ip link set can0 down"),
        ({"txqlen": 1000}, "CAN queue", Verdict.WARN, "txqueuelen 16"),
        ({"txqlen": 1}, "CAN queue", Verdict.WARN, "txqueuelen 16"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_found_and_the_fix_is_a_command(
    change: dict, check: str, verdict: Verdict, words: str
) -> None:
    found = findings(**change)
    finding = found.pop(check)
    assert finding.verdict is verdict
    assert finding.fix
    assert words in finding.found + " " + finding.fix
    assert all(each.verdict is Verdict.OK for each in found.values())


def test_a_virtual_bus_has_no_bit_rate_to_check() -> None:
    link = {"flags": ["UP"], "txqlen": 16, "linkinfo": {"info_kind": "vcan"}}
    assert [each.verdict for each in check_link(CONFIG, link)] == [Verdict.OK, Verdict.OK]


def test_a_device_that_is_no_can_device_fails() -> None:
    (finding,) = check_link(CONFIG, {"flags": ["UP"], "txqlen": 1000})
    assert finding.verdict is Verdict.FAIL
    assert "can.channel" in finding.fix


def test_a_missing_device_and_a_missing_program_are_told_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(doctor_can.shutil, "which", lambda *_, **__: None)
    assert "iproute2" in read_link("can0")
    monkeypatch.setattr(doctor_can.shutil, "which", lambda *_, **__: "/sbin/ip")
    answer = subprocess.CompletedProcess([], 1, b"", b'Device "can9" does not exist.\n')
    monkeypatch.setattr(doctor_can.subprocess, "run", lambda *_, **__: answer)
    reason = read_link("can9")
    assert reason == 'Device "can9" does not exist.'
    (finding,) = check_link(CONFIG, reason)
    assert finding.verdict is Verdict.FAIL
    assert reason in finding.found


def test_sample_points_are_those_of_cia_301() -> None:
    assert recommended_sample_point(1_000_000) == 0.75
    assert recommended_sample_point(800_000) == 0.8
    slow = (10_000, 125_000, 250_000, 500_000)
    assert {recommended_sample_point(each) for each in slow} == {0.875}


FD = CanConfig(data_bitrate=5_000_000, data_sample_point=0.5625)
FD_LINK = {"bitrate": 5000000, "sample_point": "0.562"}


def fd_findings(config: CanConfig = FD, **changes: object) -> dict[str, Finding]:
    link: dict = copy.deepcopy(CAN0) | {"mtu": 72}
    link["linkinfo"]["info_data"]["data_bittiming"] = FD_LINK
    for key, value in changes.items():
        (link if key in link else link["linkinfo"]["info_data"])[key] = value
    return {each.check: each for each in check_link(config, link)}


def test_a_good_link_of_can_fd_has_both_bit_rates() -> None:
    found = fd_findings()
    assert {each.verdict for each in found.values()} == {Verdict.OK}
    assert found["CAN data bit rate"].found == "5000000 bit/s, sample point 56.2%"


def test_what_is_wrong_with_can_fd_is_found() -> None:
    (finding,) = fd_findings(mtu=16).values()
    assert finding.verdict is Verdict.FAIL
    assert "can0 carries classic frames only (mtu 16)" in finding.found
    assert finding.fix == (
        "sudo ip link set can0 down && sudo ip link set can0 up type can bitrate 1000000 "
        "sample-point 0.75 dbitrate 5000000 dsample-point 0.5625 fd on restart-ms 100"
    )
    found = fd_findings(data_bittiming={"bitrate": 2000000, "sample_point": "0.75"})
    assert found["CAN data bit rate"].verdict is Verdict.FAIL
    assert "the robot's file says 5000000 bit/s" in found["CAN data bit rate"].found
    found = fd_findings(CanConfig(data_bitrate=5_000_000))
    assert found["CAN data bit rate"].verdict is Verdict.WARN
    assert "recommended 75.0%" in found["CAN data bit rate"].found


def test_sample_points_that_are_asked_for_can_be_had() -> None:
    """python-can's solver finds a timing of an 80 MHz controller for each pair of bit rates."""
    for bitrate in (500_000, 1_000_000):
        for data_bitrate in (1_000_000, 2_000_000, 4_000_000, 5_000_000):
            point, data_point = CanConfig(bitrate=bitrate, data_bitrate=data_bitrate).sample_points
            timing = can.BitTimingFd.from_sample_point(
                f_clock=80_000_000,
                nom_bitrate=bitrate,
                nom_sample_point=100 * point,
                data_bitrate=data_bitrate,
                data_sample_point=100 * data_point,
            )
            assert timing.nom_sample_point == pytest.approx(100 * point, abs=2.5)
            assert timing.data_sample_point == pytest.approx(100 * data_point, abs=5)


@pytest.mark.parametrize(
    ("channel", "link", "fix"),
    [
        (
            "vcan0", "Device \"vcan0\" does not exist.",
            "sudo ip link add dev vcan0 type vcan; sudo ip link set vcan0 up",
        ),
        ("vcan0", {"linkinfo": {"info_kind": "vcan"}}, "sudo ip link set vcan0 up"),
        ("sim0", {"linkinfo": {"info_kind": "vxcan"}}, "sudo ip link set sim0 up"),
    ],
)  # fmt: skip
def test_the_fix_of_a_virtual_link_sets_no_bit_rate(
    channel: str, link: dict | str, fix: str
) -> None:
    (finding,) = check_link(CanConfig(channel=channel), link)
    assert finding.verdict is Verdict.FAIL
    assert finding.fix == fix


def test_a_virtual_link_is_made_large_enough_for_can_fd() -> None:
    config = CanConfig(channel="vcan0", data_bitrate=2_000_000)
    (finding,) = check_link(config, 'Device "vcan0" does not exist.')
    assert finding.fix == ("sudo ip link add dev vcan0 mtu 72 type vcan; sudo ip link set vcan0 up")
    link = {"flags": ["UP"], "txqlen": 16, "mtu": 16, "linkinfo": {"info_kind": "vcan"}}
    (finding,) = check_link(config, link)
    assert finding.fix == (
        "sudo ip link set vcan0 down && sudo ip link set vcan0 mtu 72; sudo ip link set vcan0 up"
    )
