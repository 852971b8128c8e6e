"""The kernels of wheels in machine code, FOLDER/MACHINE/PACKAGE/*.so: `make release` calls it.

They run on any processor with the features of the baseline (`BASELINES`), so nothing is compiled
where a wheel is installed. `hatch_kernels.py` puts them into it. Those of the other kinds of
machine are made of what was compiled for this one's baseline, where Debian's compilers for them are
installed. What the folder has of exactly these sources stays, since compiling takes many minutes;
others go.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from native_kernels.library import BASELINES, wheel_library_path

PACKAGES = ("robotctl", "firmware_sim")
ROOT = Path(__file__).resolve().parents[1]
MADE = "from native_kernels.library import library_path; print(library_path({!r}))"


def main() -> int:
    """Compile them."""
    folder, machine = Path(sys.argv[1]).resolve(), platform.machine()
    if machine not in BASELINES:
        print(f"{machine}: no processor to compile for; known: {', '.join(BASELINES)}")
        return 2
    processor, _ = BASELINES[machine]
    machines = [machine, *(each for each in BASELINES if each != machine and can_build(each))]
    wanted = [path_of(folder, each, package) for each in machines for package in PACKAGES]
    for stale in set(folder.glob("*/*/*.so")).difference(wanted):
        stale.unlink()
    if all(path.exists() for path in wanted):
        return 0
    with TemporaryDirectory() as cache:
        settings = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": cache}
        environment = {**os.environ, **settings}
        command = [sys.executable, "-m", "robotctl", "compile"]
        subprocess.run(command, env=environment, check=True)
        for other in machines[1:]:
            command = [sys.executable, str(ROOT / "tools/foreign_kernels.py")]
            subprocess.run([*command, other, str(folder / other)], env=environment, check=True)
        for package in PACKAGES:
            made = subprocess.run(
                [sys.executable, "-c", MADE.format(package)],
                env=environment, check=True, capture_output=True, text=True,
            )  # fmt: skip
            path = path_of(folder, machine, package)
            path.parent.mkdir(parents=True, exist_ok=True)
            Path(shutil.copy(made.stdout.strip(), path.with_suffix(".part"))).replace(path)
    return 0


def path_of(folder: Path, machine: str, package: str) -> Path:
    """Return where the library of a package goes."""
    return folder / machine / package / wheel_library_path(package, machine).name


def can_build(machine: str) -> bool:
    """Return whether a library for another kind of machine can be linked here; say it if not."""
    compiler = f"{machine}-linux-gnu-g++"
    if shutil.which(compiler) is None:
        print(f"{machine}: neither wheel nor package: {compiler} is not installed")
        return False
    return True


if __name__ == "__main__":
    sys.exit(main())
