"""The kernels of a wheel for another kind of machine, made here.

Numba has kept their code before the last step, which is none of a processor yet. It was optimized
for the one that it was compiled for: `tools/arm-guest` takes what `make setup` has made for this
processor, `wheel_kernels.py` what it compiles for the baseline, whose vectors are as wide as ARM's.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path
from typing import Any

from llvmlite import binding

from native_kernels.build import build_library
from native_kernels.cache import cache_of, processor
from native_kernels.library import BASELINES, wheel_library_path

PACKAGES = ("robotctl", "firmware_sim")
X86_ATOMIC = "@llvm.x86.atomic.sub.cc.i64"
"""What LLVM has made of the counting of references, which only x86 can do."""
ATOMIC = """
define internal i8 @sub_is_zero(ptr %place, i64 %amount, i32 %condition) {
  %before = atomicrmw sub ptr %place, i64 %amount seq_cst
  %is_zero = icmp eq i64 %before, %amount
  %result = zext i1 %is_zero to i8
  ret i8 %result
}
"""
"""The same for any processor, for the only condition that numba asks for: the result is zero."""


def emit(module: Any, machine: str) -> bytes:
    """Return a module's code for the baseline processor of a kind of machine."""
    binding.initialize_all_targets()
    binding.initialize_all_asmprinters()
    processor, _ = BASELINES[machine]
    triple = f"{machine}-linux-gnu"
    target = binding.Target.from_triple(triple).create_target_machine(
        cpu=processor, opt=3, reloc="pic", codemodel="default"
    )
    text = re.sub(rf"declare i8 {X86_ATOMIC}\(.*", ATOMIC, str(module))
    other = binding.parse_assembly(text.replace(X86_ATOMIC, "@sub_is_zero"))
    other.triple, other.data_layout = triple, str(target.target_data)
    code: bytes = target.emit_object(other)
    return code


def main(machine: str, folder: Path) -> None:
    """Make them, with Debian's compilers for that machine."""
    for cache in map(cache_of, PACKAGES):
        # What is not in the library would be compiled by the computer that gets it, for minutes.
        if not cache.is_complete(processor()):
            sys.exit(f"{cache.folder}: not all kernels are compiled: run `make setup` first")
    programs = shutil.which(f"{machine}-linux-gnu-gcc"), shutil.which(f"{machine}-linux-gnu-g++")
    for package in PACKAGES:
        (folder / package).mkdir(parents=True, exist_ok=True)
        path = folder / package / wheel_library_path(package, machine).name
        build_library(package, path, lambda module: emit(module, machine), programs)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
