"""Checks of the CAN link by the kernel's data: `ip -json -details -statistics link show`."""

from __future__ import annotations

import shutil
import subprocess
from typing import Any, Final

import msgspec

from robotctl.deploy.check_result import Finding, fail, none, ok, warn
from robotctl.drivers.can.config import FD_MTU, CanConfig, bring_up
from robotctl.words import counted

QUEUE_FRAMES: Final = 16
"""Recommended transmit queue, four ticks of frames; a longer one would send old commands."""

_MAX_QUEUE_FRAMES = 128


def read_link(channel: str) -> dict[str, Any] | str:
    """Return the kernel's data on a network device, or the reason for its absence."""
    ip = shutil.which("ip") or shutil.which("ip", path="/usr/sbin:/sbin")
    if ip is None:
        return "the program `ip` (iproute2) is missing"
    command = [ip, "-json", "-details", "-statistics", "link", "show", channel]
    try:
        done = subprocess.run(command, capture_output=True, timeout=10.0, check=False)  # noqa: S603
        links = msgspec.json.decode(done.stdout or b"[]")
    except (OSError, subprocess.SubprocessError, msgspec.DecodeError) as error:
        return f"`ip` failed: {error}"
    if done.returncode != 0 or not links:
        return done.stderr.decode(errors="replace").strip() or f"no network device {channel}"
    link: dict[str, Any] = links[0]
    return link


def check_link(config: CanConfig, link: dict[str, Any] | str) -> list[Finding]:
    """Check the device of `config` by the result of `read_link`."""
    channel = config.channel
    if isinstance(link, str):
        fix = bring_up(config)
        if not channel.startswith("vcan"):
            fix = f"enable the adapter (docs/deploy.md, step 3), then {fix}"
        return [fail("CAN link", f"{channel}: {link}", fix)]
    info = link.get("linkinfo", {})
    kind = info.get("info_kind", "no CAN device")
    if kind not in {"can", "vcan", "vxcan"}:
        fix = f'correct can.channel of the bus "{config.name}" in the robot\'s file'
        return [fail("CAN link", f"{channel} is {kind}", fix)]
    up = bring_up(config, kind)
    if "UP" not in link.get("flags", ()):
        return [fail("CAN link", f"{channel} is down", up)]
    queue = _check_queue(channel, int(link.get("txqlen", 0)))
    down = f"sudo ip link set {channel} down && {up}"
    mtu = int(link.get("mtu", FD_MTU))
    if config.data_bitrate and mtu < FD_MTU:
        words = f"{channel} carries classic frames only (mtu {mtu}); the robot's file wants CAN FD"
        return [fail("CAN link", words, down)]
    if kind != "can":
        return [ok("CAN link", f"{channel} is up, a virtual bus ({kind})"), queue]
    data = info.get("info_data", {})
    return [
        ok("CAN link", f"{channel} is up"),
        *_check_timings(config, data, down),
        _check_controller(channel, data, info.get("info_xstats", {}), down),
        _check_restart(int(data.get("restart_ms", 0)), down),
        queue,
    ]


def _check_timings(config: CanConfig, data: dict[str, Any], fix: str) -> list[Finding]:
    """Check bit rates and sample points."""
    point, data_point = config.sample_points
    check = "CAN bit rate"
    findings = [_check_timing(check, config.bitrate, point, data.get("bittiming", {}), fix)]
    if config.data_bitrate:
        timing = data.get("data_bittiming", {})
        check = "CAN data bit rate"
        findings.append(_check_timing(check, config.data_bitrate, data_point, timing, fix))
    return findings


def _check_timing(
    check: str, wanted: int, wanted_point: float, timing: dict[str, Any], fix: str
) -> Finding:
    """Check one bit rate [bit/s] and its sample point."""
    bitrate, point = int(timing.get("bitrate", 0)), float(timing.get("sample_point", 0))
    words = f"{bitrate} bit/s, sample point {point:.1%}"
    if bitrate != wanted:
        return fail(check, f"{words}; the robot's file says {wanted} bit/s", fix)
    if abs(point - wanted_point) > 0.05:
        return warn(check, f"{words}; recommended {wanted_point:.1%}", fix)
    return ok(check, words)


def _check_controller(
    channel: str, data: dict[str, Any], statistics: dict[str, Any], fix: str
) -> Finding:
    """Check fault confinement and the error counters."""
    check = "CAN errors"
    state = str(data.get("state", "unknown"))
    counters = data.get("berr_counter", {})
    sending, receiving = counters.get("tx", 0), counters.get("rx", 0)
    words = (
        f"{state.lower()}, error counters tx {sending} rx {receiving}, "
        f"bus-off {counted(statistics.get('bus_off', 0), 'time')}, "
        f"bus errors {statistics.get('bus_error', 0)}"
    )
    if state in {"ERROR-ACTIVE", "ERROR-WARNING"}:
        if sending == receiving == 0 and state == "ERROR-ACTIVE":
            return ok(check, words)
        return warn(check, words, f"check termination (60 ohm) and wiring: candump -e {channel}")
    if state in {"STOPPED", "SLEEPING"}:
        return fail(check, words, fix)
    return fail(
        check, words, f"check wiring, bit rate and that another node acknowledges, then {fix}"
    )


def _check_restart(restart_ms: int, fix: str) -> Finding:
    """Check that the controller recovers from bus-off."""
    check = "CAN restart-ms"
    if restart_ms > 0:
        return ok(check, f"{restart_ms} ms")
    return fail(check, "0: after bus-off the controller stays silent for ever", fix)


def _check_queue(channel: str, frames: int) -> Finding:
    """Check that the transmit queue holds a few ticks and no more."""
    check = "CAN queue"
    if QUEUE_FRAMES // 2 <= frames <= _MAX_QUEUE_FRAMES:
        return ok(check, f"{frames} frames")
    fix = f"sudo ip link set {channel} txqueuelen {QUEUE_FRAMES}"
    return warn(check, f"{frames} frames", fix)


def no_kernel_link(config: CanConfig) -> Finding:
    """Return the finding for a simulated bus, which has no network device."""
    return none("CAN link", f"{config.interface} {config.channel}: simulated, no network device")
