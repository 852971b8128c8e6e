"""Checks of the computer: kernel, processors, clocks, disk, devices.

Each is a function of files below `root`: a folder with a few files is a computer to test on.
"""

from __future__ import annotations

import ctypes
import os
import struct
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from robotctl.deploy.check_result import Finding, fail, none, ok, warn
from robotctl.model.sensors.camera import SIMULATED, CameraConfig
from robotctl.model.sensors.lidar import SOCKET, LidarConfig

MIN_FREE_BYTES: Final = 1_000_000_000
"""Minimum free space, a day of logs [B]."""

MIN_WRITE_BYTES_S: Final = 2_000_000
"""Minimum write speed, ten times the rate of a robot's logs [B/s]."""

_GOOD_CLOCKS: Final = ("tsc", "arch_sys_counter", "kvm-clock")
_BLOCK = 1_000_000
_BLOCKS = 16
_STA_UNSYNC = 0x40
_TIMEX_BYTES = 256
_TIMEX_STATUS_AT = 40


def _read(path: Path) -> str | None:
    """Return the text of a file without its line end; None if it cannot be read."""
    try:
        return path.read_text().strip()
    except OSError:
        return None


def check_preemption(root: Path) -> Finding:
    """Check that the kernel is one with PREEMPT_RT."""
    check = "kernel"
    version = _read(root / "proc/version") or "unknown"
    release = version.split()[2] if len(version.split()) > 2 else version
    if _read(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in version:
        return ok(check, f"{release} with PREEMPT_RT")
    return warn(
        check,
        f"{release} without PREEMPT_RT: ticks may be some milliseconds late",
        "install a kernel with PREEMPT_RT: docs/deploy.md, step 2",
    )


def check_governor(root: Path) -> Finding:
    """Check that no processor changes its frequency with load."""
    check = "frequency governor"
    governors = {
        path.parts[-3]: _read(path) or "unknown"
        for path in sorted(
            (root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
        )
    }
    if not governors:
        return none(check, "this kernel does not control the processors' frequency")
    others = [
        f"{cpu} {governor}" for cpu, governor in governors.items() if governor != "performance"
    ]
    if not others:
        return ok(check, f"performance on {len(governors)} processors")
    return warn(
        check,
        ", ".join(others),
        "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor "
        "(the installed service sets it at each start)",
    )


def check_clock_source(root: Path) -> Finding:
    """Check that the clock source is the processor, not a slow device."""
    check = "clock source"
    source = _read(root / "sys/devices/system/clocksource/clocksource0/current_clocksource")
    if source is None:
        return none(check, "this kernel does not report it")
    if source in _GOOD_CLOCKS:
        return ok(check, source)
    return warn(
        check,
        f"{source}: reading the time is slow",
        f"boot with one of clocksource={'|'.join(_GOOD_CLOCKS)}, if the machine has it",
    )


def parse_cpu_list(text: str) -> frozenset[int]:
    """Return the processors of a list such as `0-2,5`, cpuset(7)."""
    cpus: set[int] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        cpus.update(range(int(first), int(last or first) + 1))
    return frozenset(cpus)


def check_isolation(root: Path, cpu: int) -> Finding:
    """Check that the control loop has a processor for itself; `cpu` is `runtime.cpu`."""
    check = "isolated processors"
    isolated = parse_cpu_list(_read(root / "sys/devices/system/cpu/isolated") or "")
    online = parse_cpu_list(_read(root / "sys/devices/system/cpu/online") or "")
    words = f"isolated: {', '.join(map(str, sorted(isolated))) or 'none'}; runtime.cpu = {cpu}"
    if cpu >= 0 and online and cpu not in online:
        allowed = ", ".join(map(str, sorted(online)))
        return fail(check, f"{words}: no such processor", f"set runtime.cpu to one of {allowed}")
    if cpu in isolated:
        return ok(check, words)
    if len(online) < 3:
        return none(check, f"{words}; {len(online)} processors are too few to isolate one")
    last = max(online)
    wanted = cpu if cpu >= 0 else max(isolated, default=last)
    fixes = []
    if wanted not in isolated:
        fixes.append(f"add isolcpus={wanted} nohz_full={wanted} to the kernel's command line")
    if cpu < 0:
        fixes.append(f"set runtime.cpu = {wanted}")
    return warn(check, words, " and ".join(fixes))


def check_time_sync(status: int | None) -> Finding:
    """Check that the wall clock is synchronised; `status` as of `clock_status`."""
    check = "time synchronisation"
    if status is None:
        return none(check, "this kernel does not report it")
    if status & _STA_UNSYNC:
        return warn(
            check,
            "the wall clock is not synchronised: logs carry the wrong time",
            "sudo timedatectl set-ntp true",
        )
    return ok(check, "the wall clock is synchronised")


def clock_status() -> int | None:
    """Return the status bits of the kernel's clock discipline, adjtimex(2); None if refused."""
    buffer = ctypes.create_string_buffer(_TIMEX_BYTES)
    if ctypes.sizeof(ctypes.c_long) != 8 or ctypes.CDLL(None).adjtimex(buffer) < 0:
        return None
    return int(struct.unpack_from("=i", buffer, _TIMEX_STATUS_AT)[0])


def check_space(folder: Path, free_bytes: int) -> Finding:
    """Check the free space for logs."""
    check = "disk space"
    words = f"{free_bytes / 1e9:.1f} GB free for {folder}"
    if free_bytes >= MIN_FREE_BYTES:
        return ok(check, words)
    return fail(check, words, f"free at least {MIN_FREE_BYTES / 1e9:g} GB there")


def check_write_speed(folder: Path, bytes_s: float) -> Finding:
    """Check that the medium is faster than the logs."""
    check = "write speed"
    words = f"{bytes_s / 1e6:.1f} MB/s to {folder}, synchronised"
    if bytes_s >= MIN_WRITE_BYTES_S:
        return ok(check, words)
    fix = "put the logs on a faster medium: an SSD, or an SD card of class A2"
    return fail(check, f"{words}; needed {MIN_WRITE_BYTES_S / 1e6:g} MB/s", fix)


def measure_write_speed(folder: Path) -> float:
    """Write 16 MB, wait for the medium, and return the speed [B/s]; the file is removed.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    path = folder / f".robotctl-doctor-{os.getpid()}"
    block = os.urandom(_BLOCK)
    begin_s = time.monotonic()
    try:
        with path.open("wb") as file:
            for _ in range(_BLOCKS):
                file.write(block)
            file.flush()
            os.fsync(file.fileno())
        return _BLOCKS * _BLOCK / (time.monotonic() - begin_s)
    finally:
        path.unlink(missing_ok=True)


def check_disk(folder: Path) -> list[Finding]:
    """Check space and speed of the medium below `folder`, or its nearest parent that exists."""
    while not os.path.isdir(folder):  # noqa: PTH112 - where nobody may look, look further up
        if os.path.lexists(folder):
            fix = "move that away, or name another folder with --logs"
            return [fail("logs", f"{folder} is not a folder", fix)]
        folder = folder.parent
    status = os.statvfs(folder)
    findings = [check_space(folder, status.f_bavail * status.f_frsize)]
    try:
        return [*findings, check_write_speed(folder, measure_write_speed(folder))]
    except OSError as error:
        text = f"{folder} cannot be written: {error.strerror}"
        fix = "run as the robot's user or as root, or name another folder with --logs"
        return [*findings, fail("write speed", text, fix)]


def check_device(check: str, path: Path, groups: str) -> Finding:
    """Check that a device exists and that this user may read and write it."""
    if not path.exists():
        return fail(
            check, f"{path} is not there", f"plug it in, or correct {path} in the robot's file"
        )
    if os.access(path, os.R_OK | os.W_OK):
        return ok(check, f"{path} may be read and written")
    return fail(
        check,
        f"{path}: no right to read and write",
        f"sudo usermod -aG {groups} $USER, then log in again",
    )


def check_camera(camera: CameraConfig | None, root: Path) -> Finding:
    """Check the source of an enabled camera: a device, or a file, which must only be readable.

    A stream is not opened, since it may start with the robot.
    """
    check = "camera"
    if camera is None or not camera.enabled:
        return none(check, "camera disabled: camera.enabled is not true")
    source = camera.source
    if source == SIMULATED or "://" in source:
        return none(check, f"not checked: camera.source is {source}")
    if source.isdecimal():
        source = f"/dev/video{source}"
    path = root / source.lstrip("/") if source.startswith("/") else Path(source)
    if path.is_file() and os.access(path, os.R_OK):
        return ok(check, f"{path} may be read")
    return check_device(check, path, "video")


def check_lidars(lidars: Sequence[LidarConfig], root: Path) -> list[Finding]:
    """Check the rights on the serial lines of the lidars that a driver of ours reads."""
    check = "lidar"
    devices = [each.device for each in lidars if each.driver != SOCKET]
    if not devices:
        return [none(check, "no driver of ours reads one: the table [lidar] is missing or says so")]
    return [check_device(check, root / each.lstrip("/"), "dialout") for each in devices]


def check_serial(urls: Sequence[str], root: Path) -> list[Finding]:
    """Check the rights on the serial lines that the configuration names (absolute paths)."""
    if not urls:
        return [none("serial lines", "the configuration names none")]
    return [check_device("serial lines", root / url.lstrip("/"), "dialout") for url in urls]
