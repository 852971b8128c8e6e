"""Digests of kernels cover all that Python and numba find in them, asked of the loaded modules."""

import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core import types
from numba.core.dispatcher import Dispatcher

from native_kernels import by_numba
from native_kernels.cache import cache_of
from native_kernels.digests import KernelDigests

PACKAGES = ("robotctl", "firmware_sim")
COMPILER = Path(by_numba.__file__).read_bytes()


@pytest.fixture(scope="module", params=PACKAGES)
def digests(request: pytest.FixtureRequest) -> KernelDigests:
    """Return the digests of a package, from its sources."""
    package = cache_of(request.param).package
    sources = {path: path.read_bytes() for path in package.rglob("*.py")}
    return KernelDigests(package, sources, COMPILER)


def loaded(digests: KernelDigests) -> Iterator[tuple[tuple[str, str], Any]]:
    """Yield the kernels at the top of modules, by module and name."""
    for each in digests.all():
        module, _, name = each.partition(":")
        kernel = getattr(import_module(module), name)
        if hasattr(kernel, "py_func"):
            yield (module, name), kernel if isinstance(kernel, Dispatcher) else kernel.dispatcher


def places(value: Any, name: str, definitions: set[tuple[str, str]]) -> Iterator[bool]:
    """Yield for a global of a kernel whether its digest covers it."""
    if hasattr(value, "py_func"):
        yield (value.py_func.__module__, value.py_func.__name__) in definitions
    elif inspect.isclass(value):
        if value.__module__.partition(".")[0] in PACKAGES:
            yield (value.__module__, value.__name__) in definitions
    elif isinstance(value, (int, float, tuple, np.ndarray)):
        known = [module for module, known in definitions if known == name]
        yield any(vars(import_module(module))[name] is value for module in known)


def test_all_that_a_kernel_names_is_covered(digests: KernelDigests) -> None:
    found = [
        (kernel, name, place)
        for kernel, dispatcher in loaded(digests)
        for definitions in [{*digests.definitions_of(kernel)}]
        for name, value in inspect.getclosurevars(dispatcher.py_func).globals.items()
        for place in places(value, name, definitions)
    ]
    assert len(found) > len(digests.all())
    assert [each[:2] for each in found if not each[2]] == []


def named_tuples(kind: Any) -> Iterator[type]:
    """Yield the classes of named tuples in the type of an argument."""
    if isinstance(kind, types.BaseNamedTuple):
        yield kind.instance_class
    if isinstance(kind, types.BaseTuple):
        for each in kind:
            yield from named_tuples(each)


def test_the_classes_of_what_kernels_are_given_are_covered(digests: KernelDigests) -> None:
    given = {
        (kernel, (each.__module__, each.__name__))
        for kernel, dispatcher in loaded(digests)
        for key in dispatcher._cache._cache_file._load_index()
        for kind in key[0]
        for each in named_tuples(kind)
    }
    if not given and digests.package.name == "robotctl":  # the simulator's take none
        pytest.skip("nothing is compiled ahead of time here: `robotctl compile` does it")
    missing = [each for each in given if each[1] not in digests.definitions_of(each[0])]
    assert missing == []
