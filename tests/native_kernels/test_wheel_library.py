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

from native_kernels.library import compilers

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
BASELINE = """
import platform
from pathlib import Path
from native_kernels.build import build
from robotctl.kernel import half
half(3.0)
build("robotctl", platform.machine(), Path("robotctl"))
"""
FOREIGN = """
from native_kernels.build import _linked, _versions, for_machine
from native_kernels.cache import cache_of
from robotctl.kernel import total
total(3)
module = _linked([*_versions(cache_of("robotctl").folder)])
other, emitter = for_machine(module, "aarch64")
print("llvm.x86" in str(module), "llvm.x86" in str(other), emitter.emit_object(other)[18])
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


@pytest.fixture(scope="module", params=[BUILD, BASELINE], ids=["this", "baseline"])
def installed(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """Return the folder of an installation with the wheel's library."""
    folder = tmp_path_factory.mktemp("installed")
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "native_kernels", folder / "native_kernels", ignore=ignore)
    (folder / "robotctl").mkdir()
    (folder / "robotctl" / "__init__.py").touch()
    (folder / "robotctl" / "kernel.py").write_text(KERNEL)
    (folder / "robotctl" / "__pycache__").write_text("no folder")
    run(folder, request.param, NUMBA_CACHE_DIR=str(folder / "cache"), TMPDIR=str(folder))
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


def test_machine_code_for_arm_is_made_on_another_computer(installed: Path, tmp_path: Path) -> None:
    shutil.copytree(installed, tmp_path / "copy")
    for library in (tmp_path / "copy" / "robotctl").glob("*.so"):
        library.unlink()
    (tmp_path / "copy" / "robotctl" / "kernel.py").write_text(KERNEL + ARRAYS)
    settings = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "TMPDIR": str(tmp_path)}
    only_x86, still, machine = run(tmp_path / "copy", FOREIGN, **settings).split()
    assert (still, int(machine)) == ("False", ARM)
    assert only_x86 == str(platform.machine() == "x86_64")
