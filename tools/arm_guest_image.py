"""Disks and kernel of `tools/arm-guest`: a Debian from its mirror, wheels from PyPI and ours.

A Debian is unpacked, not installed, since no program of another architecture runs here: what the
scripts of its packages would have set up, and a robot's computer needs, is written here.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
UV: Final = ROOT / ".cache/bootstrap/bin/uv"
PACKAGES: Final = (
    "systemd,systemd-sysv,udev,dbus,python3,python3-venv,libstdc++6,iproute2,kmod,busybox-static"
)
NOT_NEEDED: Final = (
    "usr/share/doc", "usr/share/locale", "usr/share/man", "usr/share/i18n",
    *(f"usr/lib/modules/*/kernel/{each}" for each in (
        "sound", "drivers/gpu", "drivers/media", "drivers/infiniband", "drivers/net/wireless",
        "drivers/net/ethernet", "drivers/scsi", "drivers/ata", "drivers/staging", "drivers/usb",
        "drivers/iio",
    )),
)  # fmt: skip
EARLY_MODULES: Final = ("virtio_pci", "virtio_blk", "ext4", "crc32c_generic")
"""What the disk with all other modules needs."""
HOST_PROGRAMS: Final = {
    "mmdebstrap": "mmdebstrap", "qemu-img": "qemu-utils", "depmod": "kmod", "cpio": "cpio",
    "mkfs.ext4": "e2fsprogs",
}  # fmt: skip
DISK_BYTES: Final = 6 * 2**30

INIT: Final = """#!/bin/busybox sh
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t devtmpfs dev /dev
for module in $(/bin/busybox cat /modules); do /bin/busybox insmod $module; done
/bin/busybox mount -t ext4 -o rw,noatime /dev/vda /root
/bin/busybox mount --move /dev /root/dev
/bin/busybox umount /proc
exec /bin/busybox switch_root /root /sbin/init
"""
AGENT: Final = """[Unit]
Description=runs what the host asks for
RequiresMountsFor=/mnt
DefaultDependencies=no
After=basic.target
[Service]
Environment=HOME=/root LC_ALL=C.UTF-8
ExecStart=/usr/bin/python3 -u /mnt/arm_guest_scenes.py agent
KillMode=process
"""
FIRMWARE: Final = """[Unit]
Description=the robot's drive, sonars and battery, simulated
ConditionPathExists=/opt/robotctl/bin/python
BindsTo=sys-subsystem-net-devices-can1.device
After=sys-subsystem-net-devices-can1.device
[Service]
RuntimeDirectory=firmware
RuntimeDirectoryMode=0700
StateDirectory=firmware
ExecStartPre=ip link set can1 up type can bitrate 1000000 sample-point 0.75 restart-ms 100
ExecStart=/opt/robotctl/bin/python -u -m firmware_sim --robot /mnt/robot.toml --world flat \
--start 2.5,1.2,0 --bus can1 --state /var/lib/firmware --truth ipc:///run/firmware/truth \
--priority 60
ExecStopPost=ip link set can1 down
"""
MISSION: Final = """name = "circle"
world = "flat"
start = { x_m = 2.5, y_m = 1.2, heading_deg = 0.0 }

[[item]]
kind = "circle"
x_m = 2.5
y_m = 2.5
radius_m = 1.3
turns = 100
speed_m_s = 0.45
"""
"""A service that starts anew takes the place where it stands for the start: on a circle that is the
same circle, so nothing is ever in the way."""
FILES: Final = {
    "etc/hostname": "robot\n",
    "etc/hosts": "127.0.0.1 localhost robot\n::1 localhost\n",
    "etc/machine-id": "0123456789abcdef0123456789abcdef\n",
    "etc/fstab": "/dev/vda / ext4 noatime 0 1\n/dev/vdb /mnt ext4 ro 0 0\n",
    "etc/systemd/system/agent.service": AGENT,
    "etc/systemd/system/firmware.service": FIRMWARE,
}
LINKS: Final = {
    "etc/systemd/system/multi-user.target.wants/agent.service": "../agent.service",
    "etc/systemd/system/sys-subsystem-net-devices-can1.device.wants/firmware.service":
        "../firmware.service",
    **{f"etc/systemd/system/{each}": "/dev/null" for each in (
        "systemd-networkd-wait-online.service", "systemd-firstboot.service",
        "getty-static.service", "serial-getty@.service", "e2scrub_reap.service",
        "systemd-repart.service",
    )},
}  # fmt: skip


class GuestError(Exception):
    """The guest cannot be had or has failed; the message says why and what to do."""


@dataclass(frozen=True, slots=True)
class Computer:
    """A kind of computer.

    Attributes
    ----------
    debian, machine
        Its name at Debian, and at Python and in wheels.
    package
        Package with QEMU's emulator of it.
    arguments
        Of QEMU.
    console
        Its serial line.
    kernel_line
        What its kernel is told.
    """

    debian: str
    machine: str
    package: str
    arguments: tuple[str, ...]
    console: str
    kernel_line: str = ""


COMPUTERS: Final = {
    "arm64": Computer(
        "arm64", "aarch64", "qemu-system-arm",
        ("-machine", "virt,gic-version=3", "-cpu", "cortex-a76"), "ttyAMA0",
    ),
    "x86-64": Computer(
        "amd64", "x86_64", "qemu-system-x86",
        ("-machine", "q35", "-cpu", "Nehalem,+invtsc"), "ttyS0",
        "tsc=reliable clocksource=tsc no_timer_check",
    ),
}  # fmt: skip


def say(text: str) -> None:
    """Tell the user something."""
    print(f"arm-guest: {text}", flush=True)


def cache_directory() -> Path:
    """Return where images and wheels are kept."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "robotctl" / "arm-guest"


def run(command: Sequence[str | Path], **options: Any) -> str:
    """Run a program of the host to its end and return its output.

    Raises
    ------
    GuestError
        If it fails.
    """
    result = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False, **options
    )
    if result.returncode:
        tail = "\n".join((result.stdout + result.stderr).splitlines()[-15:])
        raise GuestError(f"{' '.join(map(str, command))} failed:\n{tail}")
    return str(result.stdout)


def need_programs(computer: Computer) -> None:
    """Install missing programs of the host as root on Debian and its kin, else name them.

    Raises
    ------
    GuestError
        If they are missing and cannot be installed.
    """
    compiler = f"{computer.machine}-linux-gnu"
    programs = HOST_PROGRAMS | {
        f"qemu-system-{computer.machine}": computer.package,
        f"{compiler}-g++": f"g++-{compiler}".replace("_", "-"),
    }
    missing = sorted({package for name, package in programs.items() if shutil.which(name) is None})
    if os.geteuid() != 0:
        raise GuestError("a Debian's files belong to root: run it as root")
    if not UV.exists():
        raise GuestError(f"{UV} is missing: run `make setup`")
    if not missing:
        return
    install = ["apt-get", "install", "-y", "--no-install-recommends", *missing]
    if shutil.which("apt-get") is None:
        raise GuestError(f"these packages are not installed: {', '.join(missing)}")
    say(f"installing {', '.join(missing)} (once)")
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    run(["apt-get", "update", "-q"], env=environment)
    run(install, env=environment)


def debian(computer: Computer) -> Path:
    """Return a folder with `disk.img`, `vmlinuz` and `initrd`, made if this is the first time."""
    recipe = Path(__file__).read_text().partition("def stick(")[0]
    key = hashlib.sha256(recipe.encode()).hexdigest()[:12]
    target = cache_directory() / f"debian-12-{computer.debian}-{key}"
    if target.is_dir():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    for old in target.parent.glob(f"debian-12-{computer.debian}-*"):
        shutil.rmtree(old)
    say(f"building a Debian 12 for {computer.debian} (once, some two minutes)")
    with tempfile.TemporaryDirectory(prefix="build-", dir=target.parent) as name:
        folder, root = Path(name) / "made", Path(name) / "root"
        folder.mkdir()
        run([
            "mmdebstrap", "--quiet", "--variant=extract", f"--architectures={computer.debian}",
            "--hook-dir=/usr/share/mmdebstrap/hooks/merged-usr", "--format=directory",
            "--include=?essential", f"--include={PACKAGES},linux-image-{computer.debian}",
            "bookworm", str(root),
        ])  # fmt: skip
        _set_up(root)
        _early_root(root, folder)
        with (folder / "disk.img").open("wb") as disk:
            disk.truncate(DISK_BYTES)
        run(["mkfs.ext4", "-q", "-d", root, folder / "disk.img"])
        folder.rename(target)
    return target


def _set_up(root: Path) -> None:
    """Write what the packages' own scripts would have, and what makes a robot's computer of it."""
    for pattern in NOT_NEEDED:
        for path in root.glob(pattern):
            shutil.rmtree(path)
    for name in ("passwd", "group"):
        shutil.copy(root / f"usr/share/base-passwd/{name}.master", root / "etc" / name)
    for name, text in FILES.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    for name, target in LINKS.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).unlink(missing_ok=True)
        (root / name).symlink_to(target)
    (root / "var/log/journal").mkdir()
    (root / "mnt").mkdir(exist_ok=True)
    (root / "tmp").chmod(0o1777)
    run(["depmod", "-b", str(root), _kernel(root)])


def _kernel(root: Path) -> str:
    """Return the version of the kernel that was unpacked."""
    return next((root / "boot").glob("vmlinuz-*")).name.removeprefix("vmlinuz-")


def _early_root(root: Path, folder: Path) -> None:
    """Write the kernel, and the first root with the modules that it needs to read the disk."""
    version = _kernel(root)
    shutil.copy(root / f"boot/vmlinuz-{version}", folder / "vmlinuz")
    early = folder / "early"
    for name in ("bin", "dev", "proc", "root"):
        (early / name).mkdir(parents=True)
    shutil.copy(root / "bin/busybox", early / "bin/busybox")
    (early / "init").write_text(INIT)
    (early / "init").chmod(0o755)
    names: list[str] = []
    for module in EARLY_MODULES:
        told = run(["modprobe", "-d", str(root), "-S", version, "--show-depends", module])
        for line in told.splitlines():
            if line.startswith("insmod"):
                path = Path(line.split()[1])
                if path.name not in names:
                    names.append(path.name)
                    shutil.copy(path, early / path.name)
    (early / "modules").write_text("\n".join(f"/{name}" for name in names))
    command = f"cd {early} && find . | cpio --quiet -o -H newc > ../initrd"
    run(["sh", "-ec", command])
    shutil.rmtree(early)


def stick(computer: Computer, folder: Path, release: Path | None) -> tuple[Path, str]:
    """Return a disk with robotctl, the robot's files and the scenes, and the digest of robotctl.

    That is the package of a release, or else the wheel of this checkout with all others.
    """
    content = folder / "stick"
    content.mkdir()
    if release is None:
        artefact = _wheel(computer, folder)
        _put_wheels(computer, artefact, content)
    else:
        found = sorted(release.glob(f"robotctl_*_{computer.debian}.deb"))
        if len(found) != 1:
            raise GuestError(f"{release}: {len(found)} packages for {computer.debian}, not one")
        (artefact,) = found
        shutil.copy(artefact, content / "robotctl.deb")
    shutil.copy(ROOT / "configs/diff_drive.toml", content / "robot.toml")
    (content / "circle.toml").write_text(MISSION)
    shutil.copy(ROOT / "tools/arm_guest_scenes.py", content)
    disk = folder / "stick.img"
    size = sum(path.stat().st_size for path in content.rglob("*") if path.is_file())
    with disk.open("wb") as file:
        file.truncate(size * 5 // 4 + 2**25)
    run(["mkfs.ext4", "-q", "-O", "^has_journal", "-d", content, disk])
    shutil.rmtree(content)
    return disk, hashlib.sha256(artefact.read_bytes()).hexdigest()[:12]


def _put_wheels(computer: Computer, wheel: Path, content: Path) -> None:
    """Put a wheel on the stick, those that it needs, and uv, which installs them."""
    shutil.copytree(_dependencies(computer), content / "wheels", copy_function=os.link)
    shutil.copy(wheel, content / "wheels")
    with zipfile.ZipFile(next((content / "wheels").glob("uv-*.whl"))) as archive:
        program = next(each for each in archive.namelist() if each.endswith("/scripts/uv"))
        (content / "uv").write_bytes(archive.read(program))
    (content / "uv").chmod(0o755)


def _dependencies(computer: Computer) -> Path:
    """Return a folder with the wheels of all packages that ours needs, as uv.lock says."""
    with tempfile.TemporaryDirectory() as name:
        wanted = Path(name) / "all.txt"
        run([UV, "export", "--quiet", "--frozen", "--no-dev", "--no-emit-project", "--no-hashes",
             "--output-file", wanted], cwd=ROOT)  # fmt: skip
        platform = f"{computer.machine}-manylinux_2_36"
        pinned = run([
            UV, "pip", "compile", "--quiet", "--no-deps", "--no-header", "--no-annotate",
            "--system-certs", "--python-version", "3.11", "--python-platform", platform, wanted,
        ])  # fmt: skip
    pinned += f"uv=={run([UV, '--version']).split()[1]}\n"
    key = hashlib.sha256(pinned.encode()).hexdigest()[:12]
    target = cache_directory() / f"wheels-{computer.machine}-{key}"
    if target.is_dir():
        return target
    for old in cache_directory().glob(f"wheels-{computer.machine}-*"):
        shutil.rmtree(old)
    say("downloading wheels (once)")
    glibc = [f"manylinux_2_{minor}_{computer.machine}" for minor in range(36, 4, -1)]
    named = [f"manylinux{each}_{computer.machine}" for each in (2014, 2010, 1)]
    with tempfile.TemporaryDirectory(prefix="build-", dir=cache_directory()) as name:
        folder = Path(name) / "made"
        (Path(name) / "pinned.txt").write_text(pinned)
        run([
            UV.with_name("python"), "-m", "pip", "download", "--quiet", "--no-deps",
            "--dest", folder,
            "--only-binary=:all:", "--python-version=3.11", "--implementation=cp",
            *(f"--abi={each}" for each in ("cp311", "abi3", "none")),
            *(f"--platform={each}" for each in (*glibc, *named)),
            "--requirement", Path(name) / "pinned.txt",
        ])  # fmt: skip
        folder.rename(target)
    return target


def _wheel(computer: Computer, folder: Path) -> Path:
    """Return the wheel of this checkout, with kernels in machine code for the computer's kind.

    They are made of what `make setup` has compiled for this computer.
    """
    python = ROOT / ".venv/bin/python"
    ask = (
        "import sys; from native_kernels.cache import cache_of; print(sys.version_info[:2],"
        " cache_of('robotctl').digest, cache_of('firmware_sim').digest, sep='-')"
    )
    version, _, digests = run([python, "-c", ask], cwd=ROOT).strip().partition("-")
    if version != "(3, 11)":
        raise GuestError(f"Debian 12 has Python 3.11, and {python} is {version}")
    kernels = cache_directory() / f"kernels-{computer.machine}-{digests}"
    if not kernels.is_dir():
        for old in cache_directory().glob(f"kernels-{computer.machine}-*"):
            shutil.rmtree(old)
        made = folder / "kernels"
        run([python, ROOT / "tools/foreign_kernels.py", computer.machine, made], cwd=ROOT)
        made.rename(kernels)
    run(
        [UV, "build", "--quiet", "--system-certs", "--wheel", "--out-dir", folder / "wheel"],
        cwd=ROOT,
        env={**os.environ, "ROBOTCTL_KERNELS": str(kernels)},
    )
    return next((folder / "wheel").glob("*.whl"))
