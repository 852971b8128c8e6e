"""What is compiled already, for copies of robotctl: they need not compile for a minute."""

import os
import shutil
from pathlib import Path

from native_kernels.cache import cache_of


def copied_code(folder: Path) -> dict[str, str]:
    """Copy the compiled code into a folder; return an environment that names it.

    It is of use only to a copy with the same compiled sources.
    """
    for package in ("robotctl", "firmware_sim"):
        code = Path(cache_of(package).folder)
        shutil.copytree(code, folder / package / code.name)
    return {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
