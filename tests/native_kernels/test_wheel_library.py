"""A library of kernels that a wheel brings along, in an installation that keeps nothing itself."""

import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from native_kernels.library import BASELINES, compilers

ROOT = Path(__file__).parents[2]
KERNEL = """from native_kernels.compiled import compiled


@compiled
def half(x):
    return 0.5 * x
"""
ARRAYS = """

import numpy as np


@compiled
def total(n):
    return np.ones(n).sum()
"""
BUILD = """
import shutil
from native_kernels.build import build
from native_kernels.library import library_path, wheel_library_path
from robotctl.kernel import half
half(3.0)
build("robotctl")
shutil.move(library_path("robotctl"), wheel_library_path("robotctl"))
"""
FOREIGN = """
import platform
from pathlib import Path
import foreign_kernels
from native_kernels.build import build_library
from native_kernels.library import compilers, wheel_library_path
from robotctl.kernel import half, total
half(3.0), total(3)


def emit(module):
    code = foreign_kernels.emit(module, "aarch64")
    print(code[18], "llvm.x86" in str(module))
    return foreign_kernels.emit(module, platform.machine())


build_library("robotctl", wheel_library_path("robotctl"), emit, compilers())
"""
ARM = 183
"""Of an ELF file (e_machine)."""
CALL = """
import json, sys
from native_kernels import library
words = sys.argv[1]
if words:
    library._processor_lines = words.splitlines
from robotctl.kernel import half
print(json.dumps([half(3.0), "numba" in sys.modules]))
"""
HERE = ""
TOO_OLD = "flags\t: fpu sse sse2\nFeatures\t: fp"

pytestmark = pytest.mark.skipif(not all(compilers()), reason="no compiler for C and C++")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an installation with the wheel's library."""
    folder = tmp_path_factory.mktemp("installed")
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "native_kernels", folder / "native_kernels", ignore=ignore)
    (folder / "robotctl").mkdir()
    (folder / "robotctl" / "__init__.py").touch()
    (folder / "robotctl" / "kernel.py").write_text(KERNEL)
    (folder / "robotctl" / "__pycache__").write_text("no folder")
    run(folder, BUILD, NUMBA_CACHE_DIR=str(folder / "cache"), TMPDIR=str(folder))
    shutil.rmtree(folder / "cache")
    return folder


def run(folder: Path, code: str, *arguments: str, **settings: str) -> str:
    """Return what code says that runs beside the packages of a folder, and can keep nothing."""
    environment = {"PATH": os.environ["PATH"], "HOME": "/proc", "TMPDIR": "/proc", **settings}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=folder, env=environment, check=True,
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    return done.stdout


def called(folder: Path, processor: str) -> Any:
    """Return what a kernel gives for 3 on a processor, and whether numba was loaded for it."""
    return json.loads(run(folder, CALL, processor))


def test_nothing_is_compiled_where_it_is_installed(installed: Path) -> None:
    assert called(installed, HERE) == [1.5, False]


def test_a_processor_that_is_too_old_for_it_compiles(installed: Path) -> None:
    assert called(installed, TOO_OLD) == [1.5, True]


def test_other_sources_are_compiled(installed: Path, tmp_path: Path) -> None:
    shutil.copytree(installed, tmp_path / "changed")
    kernel = tmp_path / "changed" / "robotctl" / "kernel.py"
    kernel.write_text(KERNEL.replace("0.5 * x", "0.25 * x"))
    assert called(tmp_path / "changed", HERE) == [0.75, True]


@pytest.mark.skipif(platform.machine() not in BASELINES, reason="no baseline of this machine")
def test_the_kernels_are_made_for_another_kind_of_machine(installed: Path, tmp_path: Path) -> None:
    shutil.copytree(installed, tmp_path / "copy")
    for library in (tmp_path / "copy" / "robotctl").glob("*.so"):
        library.unlink()
    (tmp_path / "copy" / "robotctl" / "kernel.py").write_text(KERNEL + ARRAYS)
    settings = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "TMPDIR": str(tmp_path)}
    settings["PYTHONPATH"] = str(ROOT / "tools")
    machine, only_x86 = run(tmp_path / "copy", FOREIGN, **settings).split()
    assert (int(machine), only_x86) == (ARM, str(platform.machine() == "x86_64"))
    total = "import sys; from robotctl.kernel import total; print(total(3), 'numba' in sys.modules)"
    assert run(tmp_path / "copy", total).split() == ["3.0", "False"]
