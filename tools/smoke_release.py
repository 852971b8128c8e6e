"""Try each artefact of a release where nothing else is: `make release` calls it.

The wheel in a fresh virtual environment with an empty environment, the Debian package in a fresh
Debian (mmdebstrap, as root), the image in a container without network, with a read-only root
(podman). In each the program must tell its version, examine a computer, drive five seconds of
the patrol in lockstep to the very CAN frames that this checkout sends, and compile nothing.

A line for each: passed, failed or not run, and why. Status 1: one has failed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

CAN_LOG = "record/can-0001.log"
DRIVE = "robotctl sim --headless --lockstep --mission patrol --max-seconds 5 --record"
LIMIT_REACHED = 3
TRIAL = f"""
out=$1; shift
robotctl version > $out/version || exit
robotctl compile > $out/compile 2>&1 || exit
robotctl doctor --robot diff_drive --json > $out/doctor || [ $? = 1 ] || exit
{DRIVE} $out/record > $out/drive 2>&1 || [ $? = {LIMIT_REACHED} ] || exit
find "$@" -name '*.nbi' -o -name 'native-*.so' > $out/compiled
"""
"""The trial, by a shell: a folder for what it finds, and the folders in which code may lie."""
RELEASES = {"python3.11": "bookworm", "python3.13": "trixie"}
"""Debian whose Python this is."""
PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
LEFT = ("opt/robotctl", "usr/bin/robotctl", "etc/robotctl", "etc/systemd/system/robotctl.service")
"""What the package and `robotctl install` bring, and a removal takes away."""
OF_OLD = "opt/robotctl/lib/of_an_older_version.py"
"""What only the older package has, from which the trial updates."""
KEPT = "# this line is the user's own\n"


class NotRunError(Exception):
    """What this computer lacks to try an artefact."""


class FailedError(Exception):
    """What is wrong with an artefact."""


@dataclass(frozen=True, slots=True)
class Expected:
    """What an artefact must show: version, and SHA-256 of the CAN log of the drive."""

    version: str
    can_log: str


def check(out: Path, expected: Expected) -> None:
    """Check what a trial has found.

    Raises
    ------
    FailedError
        If something is missing or different.
    """
    try:
        said = (out / "version").read_text().strip()
        compiled = (out / "compile").read_text().strip()
        findings = json.loads((out / "doctor").read_text())["findings"]
        log = hashlib.sha256((out / CAN_LOG).read_bytes()).hexdigest()
        left = (out / "compiled").read_text().split()
    except (OSError, ValueError, KeyError) as error:
        raise FailedError(f"the trial found too little: {error}") from error
    if said != expected.version:
        raise FailedError(f"its version is {said}, not {expected.version}")
    if "compiled already" not in compiled or "site-packages/robotctl" not in compiled:
        raise FailedError(f"its kernels are not those of the wheel: {compiled}")
    if left:
        raise FailedError(f"it has compiled: {left[0]}")
    verdicts = {each["check"]: each["verdict"] for each in findings}
    if verdicts.get("configuration") != "ok":
        raise FailedError("doctor does not find the configuration good")
    if log != expected.can_log:
        raise FailedError(f"CAN log {log[:12]}, that of the checkout {expected.can_log[:12]}")


def try_wheel(folder: Path, release: Path, out: Path, requirements: Path, uv: str) -> None:
    """Install the wheel of this platform, as uv chooses it, and try it."""
    venv, home = folder / "venv", folder / "home"
    home.mkdir()
    _do([sys.executable, "-m", "venv", "--without-pip", str(venv)])
    install = [uv, "pip", "install", "--quiet", "--system-certs", "--no-deps"]
    install += ["--python", str(venv / "bin" / "python")]
    _do([*install, "--require-hashes", "--requirement", str(requirements)])
    _do([*install, "--no-cache", "--no-index", "--find-links", str(release), "robotctl"])
    empty = ["env", "-i", f"PATH={venv}/bin:/usr/bin:/bin", f"HOME={home}", f"TMPDIR={folder}"]
    _do([*empty, "sh", "-c", TRIAL, "trial", str(out), str(venv), str(home)], cwd=folder)


def try_deb(folder: Path, release: Path, out: Path) -> None:
    """In a fresh Debian install a robot by an older package, update it, try it, remove all."""
    _need("mmdebstrap", "unshare", "chroot", "dpkg-deb")
    if os.geteuid() != 0:
        raise NotRunError("needs root, to enter another Debian")
    if PYTHON not in RELEASES:
        raise NotRunError(f"no Debian is known for {PYTHON}")
    (package,) = release.glob(f"robotctl_*_{_said('dpkg', '--print-architecture')}.deb")
    root = folder / "root"
    _do(["mmdebstrap", "--quiet", "--variant=apt", RELEASES[PYTHON], str(root)])
    shutil.copy(package, root)
    write_older(package, root / "older.deb", folder / "older")
    enter = ["unshare", "--mount", "--pid", "--fork", f"--mount-proc={root}/proc"]
    enter += ["chroot", str(root), "env", "-i", f"PATH={PATH}", "HOME=/root"]
    enter += ["DEBIAN_FRONTEND=noninteractive", "sh", "-c"]
    install = "apt-get install --quiet=2 --yes --no-install-recommends"
    _do([*enter, f"apt-get update --quiet=2 && {install} /older.deb"])
    _do([*enter, "robotctl install --robot diff_drive"])
    with (root / "etc/robotctl/robot.toml").open("a") as file:
        file.write(KEPT)
    _do([*enter, f"{install} /{package.name}"])
    if (root / OF_OLD).exists():
        raise FailedError(f"the update has left {OF_OLD}")
    if not (root / "etc/robotctl/robot.toml").read_text().endswith(KEPT):
        raise FailedError("the update has lost what the user wrote into etc/robotctl/robot.toml")
    (root / "out").mkdir()
    _do([*enter, TRIAL, "trial", "/out", "/opt", "/root", "/tmp"])
    shutil.copytree(root / "out", out, dirs_exist_ok=True)
    if missing := [name for name in LEFT if not os.path.lexists(root / name)]:
        raise FailedError(f"not installed: {', '.join(missing)}")
    _do([*enter, "apt-get purge --quiet=2 --yes robotctl"])
    if left := [name for name in LEFT if os.path.lexists(root / name)]:
        raise FailedError(f"left after it was purged: {', '.join(left)}")


def write_older(package: Path, older: Path, folder: Path) -> None:
    """Write a package as the given one, of a lower version and with a file more."""
    _do(["dpkg-deb", "--raw-extract", str(package), str(folder)])
    control = folder / "DEBIAN/control"
    lines = control.read_text().splitlines()
    lines = ["Version: 0~older" if each.startswith("Version:") else each for each in lines]
    control.write_text("\n".join(lines) + "\n")
    (folder / OF_OLD).write_text("")
    _do(["dpkg-deb", "--build", "--root-owner-group", "-Znone", str(folder), str(older)])


def try_image(release: Path, out: Path) -> None:
    """Load the image, try it as its own user, and drive in real time by its entry point."""
    _need("podman")
    found = sorted(release.glob("*image*.tar"))
    if not found:
        raise NotRunError("there is none")
    loaded = _do(["podman", "load", "--quiet", "--input", str(found[0])])
    image = loaded.split()[-1]
    run = ["podman", "run", "--rm", "--read-only", "--tmpfs", "/tmp", "--network", "none"]
    run += ["--cap-drop", "all", "--security-opt", "no-new-privileges"]
    out.chmod(0o777)
    mounted = ["--volume", f"{out}:/out", "--entrypoint", "/bin/sh", image]
    _do([*run, *mounted, "-c", TRIAL, "trial", "/out", "/opt", "/var/lib/robotctl", "/tmp"])
    drive = ["sim", "--headless", "--mission", "patrol", "--max-seconds", "5"]
    _do([*run, image, *drive], status=LIMIT_REACHED)


def tried(name: str, trial: Callable[[Path, Path], None], expected: Expected) -> bool:
    """Try an artefact and print its line; return whether it has not failed."""
    began_s = time.monotonic()
    with TemporaryDirectory(prefix="robotctl-smoke-") as folder:
        out = Path(folder) / "out"
        out.mkdir()
        try:
            trial(Path(folder), out)
            check(out, expected)
            verdict = f"passed, CAN log {expected.can_log[:12]}"
        except NotRunError as reason:
            verdict = f"not run: {reason}"
        except FailedError as reason:
            verdict = f"failed: {reason}"
    print(f"{name}: {verdict} ({time.monotonic() - began_s:.0f} s)", flush=True)
    return not verdict.startswith("failed")


def main() -> int:
    """Try all of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uv", required=True, help="the program uv")
    parser.add_argument("--requirements", type=Path, required=True, help="packages, with hashes")
    parser.add_argument("release", type=Path, help="folder of the artefacts")
    options = parser.parse_args()
    release, requirements = options.release.resolve(), options.requirements.resolve()
    with TemporaryDirectory() as folder:
        here = [sys.executable, "-m", *DRIVE.split(), f"{folder}/record"]
        _do(here, status=LIMIT_REACHED)
        log = hashlib.sha256((Path(folder) / CAN_LOG).read_bytes()).hexdigest()
    expected = Expected(version("robotctl"), log)
    uv = str(Path(options.uv).resolve())
    good = [
        tried("wheel", lambda at, out: try_wheel(at, release, out, requirements, uv), expected),
        tried("Debian package", lambda at, out: try_deb(at, release, out), expected),
        tried("image", lambda _, out: try_image(release, out), expected),
    ]
    return 0 if all(good) else 1


def _do(command: list[str], *, status: int = 0, cwd: Path | None = None) -> str:
    """Run a program and return what it printed.

    Raises
    ------
    FailedError
        If it ends with another status.
    """
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode != status:
        last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1:] or ["nothing said"]
        raise FailedError(f"{command[0]} ended with {done.returncode}, not {status}: {last[0]}")
    return done.stdout


def _said(*command: str) -> str:
    """Return what a program of the system says."""
    return _do([*command]).strip()


def _need(*programs: str) -> None:
    """Raise NotRunError for the first program that is not installed."""
    for program in programs:
        if shutil.which(program) is None:
            raise NotRunError(f"{program} is not installed")


if __name__ == "__main__":
    sys.exit(main())
