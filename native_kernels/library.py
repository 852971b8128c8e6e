"""Library of a package's kernels in machine code, which `build` makes: no numba is loaded.

It lies in the folder of the package's cache, for one processor. Where there is none, the library in
a wheel of this platform serves, compiled for a baseline processor. A kernel is taken from it if its
digest and its bytecode are those that it was compiled from.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import platform
import shutil
import sys
from collections.abc import Callable
from functools import cache, partial, update_wrapper
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from importlib.metadata import version
from importlib.util import module_from_spec
from pathlib import Path
from typing import Any, Final

from native_kernels.cache import cache_of, package_of

MODULE: Final = "kernel_library"
_PICKLE: Final = 4
"""Protocol of numba's keys."""
_OF_PROCESSOR: Final = (
    "model name", "flags", "Features", "CPU implementer", "CPU part", "CPU variant",
)  # fmt: skip
"""Lines of /proc/cpuinfo that tell what a processor can do."""
BASELINES: Final = {
    "x86_64": ("x86-64-v2", ("cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3")),
    "aarch64": ("generic", ("fp", "asimd")),
}
"""Baseline processor of a wheel's library, by kind of machine: its name in LLVM, and the features
that a processor needs to run it, as /proc/cpuinfo names them."""
LOADED: Final[list[Any]] = []
"""Libraries of this process."""


def compilers() -> tuple[str | None, str | None]:
    """Return the compilers for C and C++, as CC and CXX name them; None: there is none."""
    c, cpp = os.environ.get("CC", "cc"), os.environ.get("CXX", "c++")
    return shutil.which(c), shutil.which(cpp)


def library_path(package: str) -> Path:
    """Return where a package's library lies for this processor and this Python."""
    chosen, features = os.environ.get("NUMBA_CPU_NAME", ""), os.environ.get("NUMBA_CPU_FEATURES")
    told = f"{chosen} {features}"
    if chosen != "generic" and (not chosen or features is None):  # numba asks this processor
        told += "".join(_processor_lines())
    digest = hashlib.sha256(f"{version('numpy')} {told}".encode()).hexdigest()[:12]
    name = f"native-{sys.implementation.cache_tag}-{platform.machine()}-{digest}.so"
    return Path(cache_of(package).folder) / name


def wheel_library_path(package: str, machine: str = "") -> Path:
    """Return where a wheel's library of exactly these sources lies; `machine`: "" is this kind."""
    own = cache_of(package)
    kind = f"{sys.implementation.cache_tag}-{machine or platform.machine()}"
    return own.package / f"kernels-{own.digest}-{kind}.so"


def found_library(package: str) -> Path | None:
    """Return a package's library: the one made here, else its wheel's if this processor can run it.

    None: there is neither.
    """
    if cache_of(package).folder and (made := library_path(package)).exists():
        return made
    if not (brought := wheel_library_path(package)).exists():
        return None
    _, needed = BASELINES.get(platform.machine(), ("", ()))
    words = {word for line in _processor_lines() for word in line.split()}
    return brought if words.issuperset(needed) else None


def _processor_lines() -> list[str]:
    """Return what /proc/cpuinfo tells of the first processor."""
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    lines = text.partition("\n\n")[0].splitlines()
    return [line for line in lines if line.startswith(_OF_PROCESSOR)]


@cache
def native_library(package: str) -> Any:
    """Return a package's library; None if it has none, or numba is told to compile nothing."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return None
    if (path := found_library(package)) is None:
        return None
    loader = ExtensionFileLoader(MODULE, str(path))
    library = module_from_spec(ModuleSpec(MODULE, loader, origin=str(path)))
    loader.exec_module(library)
    LOADED.append(library)
    return library


@cache
def _table(package: str) -> dict[str, Any]:
    """Return what a library tells of itself: `versions`, named `tuples`, and `records`."""
    table: dict[str, Any] = json.loads(native_library(package).table)
    return table


def native_kernel(function: Any, dispatcher_of: Callable[[Any], Any]) -> Any:
    """Return a kernel of the library, None if it has none of exactly this function.

    Numba's dispatcher takes the calls with other types.
    """
    package = package_of(function)
    if (library := native_library(package)) is None or not (key := key_of(function)):
        return None
    _set_up(package, dispatcher_of)
    if (versions := _table(package)["versions"].get(key)) is None:
        return None
    return update_wrapper(library.Kernel(function, [*map(tuple, versions)]), function)


@cache
def _set_up(package: str, dispatcher_of: Callable[[Any], Any]) -> None:
    table = _table(package)
    records = [*map(_record, table["records"])]
    native_library(package).set_up(dispatcher_of, partial(_number_of, table["tuples"]), records)


def _record(told: Any) -> Any:
    import numpy as np  # noqa: PLC0415 - commands that compute nothing do without

    names, formats, offsets, size, aligned = told
    layout = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
    return np.dtype(layout, align=aligned)  # type: ignore[call-overload]


def _number_of(known: list[Any], kind: Any) -> int:
    """Return the number of a named tuple's class among those of a library, -1 if it is not."""
    told = [kind.__module__, kind.__qualname__, *getattr(kind, "_fields", ())]
    return known.index(told) if told in known else -1


def key_of(function: Any) -> str:
    """Return what names a kernel and what it is made of; "" for one that is of no package."""
    module, qualname, code = function.__module__, function.__qualname__, function.__code__
    digest = cache_of(package_of(function)).digests.get(f"{module}:{qualname.partition('.')[0]}")
    if digest is None:
        return ""
    closed = b""
    if function.__closure__ is not None:
        closed = pickle.dumps(
            tuple(cell.cell_contents for cell in function.__closure__), protocol=_PICKLE
        )
    codes = (hashlib.sha256(each).hexdigest() for each in (code.co_code, closed))
    return key(module, qualname, digest, *codes)


def key(*parts: str) -> str:
    """Return the key of module, name, digest, and digests of bytecode and closure."""
    return ":".join(parts)
