"""The kernels of a wheel in machine code, into a folder: `make release` calls it.

They run on any processor with the features of the baseline (`BASELINES`), so nothing is compiled
where the wheel is installed. `hatch_kernels.py` puts them into the wheel. What the folder has of
exactly these sources stays, since compiling takes many minutes; others go.
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
MADE = "from native_kernels.library import library_path; print(library_path({!r}))"


def main() -> int:
    """Compile them."""
    folder, machine = Path(sys.argv[1]), platform.machine()
    if machine not in BASELINES:
        print(f"{machine}: no processor to compile for; known: {', '.join(BASELINES)}")
        return 2
    processor, _ = BASELINES[machine]
    wanted = [folder / package / wheel_library_path(package).name for package in PACKAGES]
    for stale in set(folder.glob("*/*.so")).difference(wanted):
        stale.unlink()
    if all(path.exists() for path in wanted):
        return 0
    with TemporaryDirectory() as cache:
        settings = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": cache}
        environment = {**os.environ, **settings}
        command = [sys.executable, "-m", "robotctl", "compile"]
        subprocess.run(command, env=environment, check=True)
        for package, path in zip(PACKAGES, wanted, strict=True):
            made = subprocess.run(
                [sys.executable, "-c", MADE.format(package)],
                env=environment, check=True, capture_output=True, text=True,
            )  # fmt: skip
            path.parent.mkdir(parents=True, exist_ok=True)
            Path(shutil.copy(made.stdout.strip(), path.with_suffix(".part"))).replace(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
