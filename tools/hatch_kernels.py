"""Makes a wheel one of its platform: with the kernels in the folder that ROBOTCTL_KERNELS names.

Without it the wheel is pure Python. The names of the kernels tell the kind of machine.
"""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class KernelsHook(BuildHookInterface[Any]):
    """Takes files of a folder, each in the folder of its package, into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the kernels to a wheel that is not an editable one."""
        named = os.environ.get("ROBOTCTL_KERNELS")
        if not named or version == "editable":
            return
        folder = Path(named).resolve()
        libraries = sorted(folder.glob("*/*.so"))
        if not libraries:
            raise FileNotFoundError(f"ROBOTCTL_KERNELS: {folder} has no PACKAGE/*.so")
        for path in libraries:
            build_data["force_include"][str(path)] = str(path.relative_to(folder))
        build_data["pure_python"] = False
        machine = libraries[0].stem.rpartition("-")[2]
        if machine == platform.machine():
            build_data["infer_tag"] = True
        else:
            python = f"cp{sys.version_info.major}{sys.version_info.minor}"
            build_data["tag"] = f"{python}-{python}-linux_{machine}"
