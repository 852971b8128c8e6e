"""Library of a package's kernels in machine code, from what numba has in its cache.

Numba keeps for each version of a kernel its code before the last step (LLVM), with all that it
calls. All of them become one module, of which a compiler for C makes a library, with numba's own
helpers (`numba/pycc`) for arrays and memory.
"""

from __future__ import annotations

import json
import pickle
import subprocess
import sysconfig
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numba
import numpy as np
from llvmlite import binding
from numba.core import types
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.np.numpy_support import as_dtype

from native_kernels.cache import cache_of
from native_kernels.library import MODULE, compilers, key, library_path

_NUMBA: Final = Path(numba.__file__).parent
_C: Final = Path(__file__).with_name("library.c")
_SCALARS: Final = {types.float64: "d", types.float32: "f", types.int64: "l", types.boolean: "b",
                   types.none: "n"}  # fmt: skip
_DUMPS: Any = dumps
_FIRST: Final = ord("!")
_MOST: Final = 90
"""A number is one printable letter in a fingerprint."""
_ENVIRONMENT: Final = "_ZN08NumbaEnv"


@dataclass(frozen=True, slots=True)
class _Version:
    """A kernel for certain types of arguments: its key, types and code, and constants by place."""

    key: str
    arguments: tuple[Any, ...]
    module: Any
    function: str
    wrapper: str
    environment: str
    constants: dict[str, list[Any]]


@dataclass(slots=True)
class _Table:
    """Contents of the library, as it lists them."""

    versions: dict[str, list[tuple[str, int]]] = field(default_factory=dict)
    tuples: list[list[str]] = field(default_factory=list)
    records: list[Any] = field(default_factory=list)

    def fingerprint(self, kind: Any) -> str:
        """Return the fingerprint of a type, as `fingerprint` in C; ValueError if it has none."""
        if isinstance(kind, types.Array) and _is_aligned(kind):
            return "A" + self._array(kind)
        if isinstance(kind, types.BaseTuple):
            return self._tuple(kind)
        if isinstance(kind, types.NumPyRandomGeneratorType):
            return "G"
        return _SCALARS[kind]

    def _tuple(self, kind: Any) -> str:
        head = "T"
        if isinstance(kind, types.BaseNamedTuple):
            named = kind.instance_class  # type: ignore[attr-defined] # of its two classes
            told = [named.__module__, named.__qualname__, *named._fields]
            head = "N" + _number(self.tuples, told)
        inner = "".join(map(self.fingerprint, kind.types))
        return f"{head}{chr(_FIRST + len(kind.types))}{inner}"

    def _array(self, kind: Any) -> str:
        record = chr(_FIRST)
        if isinstance(kind.dtype, types.Record):
            number = int(np.dtype("V").num)
            record = _number(self.records, _told(kind.dtype))
        else:
            number = np.dtype(bool if kind.dtype == types.boolean else str(kind.dtype)).num
        dimensions = chr(_FIRST + kind.ndim)
        return (
            f"{chr(_FIRST + number)}{record}{dimensions}{kind.layout}{'w' if kind.mutable else 'r'}"
        )


def _is_aligned(array: Any) -> bool:
    """Return whether elements lie where their type wants them; packed records may anywhere."""
    is_packed = isinstance(array.dtype, types.Record) and not array.dtype.aligned
    return array.aligned or is_packed


def _number(known: list[Any], told: Any) -> str:
    if told not in known:
        known.append(told)
    if len(known) > _MOST:
        raise ValueError(f"kernels take more than {_MOST} kinds of named tuples or records")
    return chr(_FIRST + known.index(told))


def _told(record: Any) -> Any:
    """Return names, formats, offsets, size and alignment of a record."""
    dtype: Any = as_dtype(record)
    parts = [dtype.fields[name] for name in dtype.names]
    formats = [part[0].str for part in parts]
    return [[*dtype.names], formats, [part[1] for part in parts], dtype.itemsize, record.aligned]


def build(package: str) -> None:
    """Build a package's library for this processor, in place of an earlier one.

    Raises
    ------
    OSError
        If there is no compiler for C and C++, or it cannot be written.
    CalledProcessError
        If it fails.
    """
    build_library(package, library_path(package), _machine().emit_object, compilers())


def build_library(
    package: str,
    path: Path,
    emit: Callable[[Any], bytes],
    programs: tuple[str | None, str | None],
) -> None:
    """Build a package's library, of code that `emit` and compilers for C and C++ make.

    The code that `emit` gets is optimized, but none of a processor yet.
    """
    versions = [*_versions(cache_of(package).folder)]
    table = _Table()
    for number, each in enumerate(versions):
        known = table.versions.setdefault(each.key, [])
        with suppress(KeyError, TypeError):  # types that only other kernels give it
            known.append(("".join(map(table.fingerprint, each.arguments)), number))
    module = _linked(versions)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        made = Path(folder)
        (made / "kernels.o").write_bytes(emit(module))
        (made / "tables.c").write_text(_tables(versions, module, table), encoding="ascii")
        _link(made, *programs)
        (made / "library.so").replace(path)


def _versions(folder: str) -> Iterator[_Version]:
    """Yield what a cache has for this processor."""
    here = cpu_target.target_context.codegen().magic_tuple()
    for path in sorted(Path(folder).rglob("*.nbi")):
        with path.open("rb") as file:
            if pickle.load(file) != numba.__version__:  # noqa: S301 - numba reads them, too
                continue
            stamp, index = pickle.load(file)  # noqa: S301
        for (arguments, processor, codes, *_), name in index.items():
            if processor != here or not isinstance(stamp, str):
                continue
            kept = pickle.loads((path.parent / name).read_bytes())  # noqa: S301
            (_, _, (_, bitcode)), description, own, _, _, _, _, at_start, others = kept
            if at_start:
                continue
            yield _Version(
                key(description.modname, description.qualname, stamp, *codes), arguments,
                binding.parse_bitcode(bitcode), description.llvm_func_name,
                description.llvm_cpython_wrapper_name,
                own.env_name, {each.env_name: each.consts for each in (own, *others)},
            )  # fmt: skip


def _linked(versions: list[_Version]) -> Any:
    """Return one module of all, of which only the wrappers can be seen from outside.

    Kernels that kernels call are there once. Numba's functions are not, as their names tell what
    they are within one process only.
    """
    wrappers = {each.wrapper for each in versions}
    if len(wrappers) != len(versions):
        raise ValueError("two versions of kernels have the same name")
    module = binding.parse_assembly("")
    module.triple = binding.get_process_triple()
    kernels = {each.function for each in versions}
    for each in versions:
        for function in each.module.functions:
            if not function.is_declaration and function.name not in kernels:
                function.linkage = "external" if function.name == each.wrapper else "internal"
        module.link_in(each.module)
    for function in module.functions:
        if not function.is_declaration and function.name not in wrappers:
            function.linkage = "internal"
    passes = binding.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, binding.create_pass_builder(_machine(), binding.PipelineTuningOptions(0)))
    return module


def _machine() -> Any:
    """Return what makes code for the processor that numba compiles for."""
    triple, name, features = cpu_target.target_context.codegen().magic_tuple()
    return binding.Target.from_triple(triple).create_target_machine(
        cpu=name, features=features, opt=3, reloc="pic", codemodel="default"
    )


def _tables(versions: list[_Version], module: Any, table: _Table) -> str:
    """Return the tables in C, with what they need, and what reads them."""
    constants = {name: value for each in versions for name, value in each.constants.items()}
    places = [each.name for each in module.global_variables if each.name.startswith(_ENVIRONMENT)]
    numbers = {name: number for number, name in enumerate(places)}
    lines = [
        f"#define PYCC_MODULE_NAME {MODULE}",
        "#define PYCC_USE_NRT 1",
        "#define NUMBA_LAPACK_BUILD_ILP64 0",
        "#define numba_unpickle unpickled",  # `library.c` has its own
        f'#include "{_NUMBA}/pycc/modulemixin.c"',
    ]
    for number, name in enumerate(places):
        lines.append(f'extern void *place{number} __asm__("{name}");')
        lines.append(
            f"static const char data{number}[] = {_text(_DUMPS(constants.get(name, [])))};"
        )
    for number, each in enumerate(versions):
        name = f"wrapper{number}"
        lines.append(
            f'extern PyObject *{name}(void *, PyObject *, PyObject *) __asm__("{each.wrapper}");'
        )
    lines.append(
        "static const struct { void **place; const char *data; int size; } environments[] = {"
    )
    lines += [f"{{&place{k}, data{k}, sizeof data{k} - 1}}," for k in range(len(places))]
    lines.append("};")
    lines.append("static const struct { PyObject *(*wrapper)(void *, PyObject *, PyObject *);")
    lines.append("int environment; } versions[] = {")
    lines += [f"{{wrapper{k}, {numbers[each.environment]}}}," for k, each in enumerate(versions)]
    lines.append("};")
    told = {"versions": table.versions, "tuples": table.tuples, "records": table.records}
    lines.append(f"static const char table[] = {_text(json.dumps(told).encode())};")
    lines.append(f'#include "{_C}"')
    return "\n".join(lines) + "\n"


def _text(data: bytes) -> str:
    return '"' + "".join(f"\\{byte:03o}" for byte in data) + '"'


def _link(folder: Path, c: str | None, cpp: str | None) -> None:
    """Compile the tables and numba's helpers, and put all together."""
    places = (sysconfig.get_paths()["include"], np.get_include())
    flags = ["-O2", "-fPIC", "-w", *(f"-I{each}" for each in places)]
    if not c or not cpp:
        raise FileNotFoundError("no compiler for C and C++ (cc, c++)")
    memory = str(_NUMBA / "core" / "runtime" / "nrt.cpp")
    for command in (
        [c, *flags, "-c", "tables.c", "-o", "tables.o"],
        [cpp, *flags, "-c", memory, "-o", "memory.o"],
        [c, "-shared", "kernels.o", "tables.o", "memory.o", "-o", "library.so", "-lm", "-pthread"],
    ):
        subprocess.run(command, cwd=folder, check=True)  # noqa: S603 - as CC and CXX say
