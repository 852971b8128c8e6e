"""Kernels out of the library do what the Python functions do, and need no numba for it."""

import copy
import pickle
import subprocess
import sys
import types
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from robotctl.estimation.slam.linear.assembly import pair_assembler
from robotctl.kernel_cache import DIGESTS
from robotctl.native_kernels import native_kernel, native_library
from robotctl.numba_kernels import dispatcher_of

if native_library() is None:
    pytest.skip("no library of kernels here: `robotctl compile` builds it", allow_module_level=True)

RNG = np.random.default_rng(5)
CLOUD = RNG.uniform(-1.0, 1.0, (40, 2))
CELLS = RNG.integers(0, 2, (30, 40), np.uint8)


def kernel(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(f"robotctl.{module}"), name)


def test_to_know_that_nothing_is_missing_loads_no_compiler() -> None:
    code = """
import sys
from robotctl.cli.compile import compile_missing
compile_missing(simulated=False)
assert not {"numba", "llvmlite"} & sys.modules.keys()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


CALLS: list[tuple[str, tuple[Any, ...]]] = [
    (
        "estimation.ranging.range_casting:_largest_squares",
        (RNG.integers(0, 2, (30, 40), np.uint8),),
    ),
    ("planning.path.global_planning.trees.sampling:narrow_cells", (CLOUD > 0.4,)),
    ("planning.path.global_planning.curves:_three_turns", (0.3, 1.2, -0.4, True)),
    ("estimation.slam.incremental.bayes_tree:grown_ints", (np.arange(9), 3, 4)),
]


@pytest.mark.parametrize(("place", "arguments"), CALLS, ids=[place for place, _ in CALLS])
def test_a_kernel_gives_what_its_function_gives(place: str, arguments: tuple[Any, ...]) -> None:
    function = kernel(place)
    assert isinstance(function, native_library().Kernel)
    mine, theirs = copy.deepcopy(arguments), copy.deepcopy(arguments)
    result, expected = function(*mine), function.py_func(*theirs)
    np.testing.assert_allclose(numbers(result, *mine), numbers(expected, *theirs), rtol=1e-12)


def numbers(*values: Any) -> Any:
    """Return all numbers in a row."""
    return np.hstack([np.ravel(each) for each in values if each is not None]).astype(float)


def test_all_kernels_are_in_the_library() -> None:
    found = {each: kernel(each.removeprefix("robotctl.")) for each in DIGESTS}
    made = (native_library().Kernel, type(pair_assembler))
    assert [each for each, value in found.items() if not isinstance(value, made)] == []
    assert isinstance(pair_assembler(3, 3, 3), native_library().Kernel)


NARROW = "planning.path.global_planning.trees.sampling:narrow_cells"


@pytest.mark.parametrize("change", ["integers", "read only", "strided", "by name"])
def test_other_types_go_to_numba(change: str) -> None:
    function, cells = kernel(NARROW), CLOUD > 0.4
    expected = function.py_func(cells)
    if change == "integers":
        cells = cells.astype(np.int16)
    elif change == "strided":
        cells = np.repeat(np.repeat(cells, 2, 0), 2, 1)[::2, ::2]
    cells.flags.writeable = change != "read only"
    name = function.py_func.__code__.co_varnames[0]
    result = function(**{name: cells}) if change == "by name" else function(cells)
    np.testing.assert_array_equal(result, expected)


def test_what_numba_compiles_may_call_a_kernel_of_the_library() -> None:
    inner = kernel("planning.path.global_planning.curves:_three_turns")
    outer = dispatcher_of(lambda x: inner(x, 1.2, -0.4, True))
    assert outer(0.3) == inner(0.3, 1.2, -0.4, True)


def test_a_function_with_another_body_is_not_taken_from_the_library() -> None:
    function = kernel(NARROW).py_func
    assert native_kernel(function, dispatcher_of) is not None

    def narrow_cells(cells: Any) -> Any:
        return cells

    other = types.FunctionType(narrow_cells.__code__, function.__globals__)
    other.__module__, other.__qualname__ = function.__module__, function.__qualname__
    assert native_kernel(other, dispatcher_of) is None


def test_a_wrong_number_of_arguments_is_an_error() -> None:
    with pytest.raises(TypeError, match="argument"):
        kernel(NARROW)()


def test_a_kernel_is_copied_and_sent_by_its_name() -> None:
    function = kernel(NARROW)
    assert copy.deepcopy(function) is function
    assert pickle.loads(pickle.dumps(function)) is function
    assert function.__name__ == "narrow_cells"
    assert function.__doc__ == function.py_func.__doc__


def test_with_the_library_no_numba_is_loaded() -> None:
    code = (
        "import sys, numpy as np\n"
        "from robotctl.planning.path.global_planning.trees.sampling import narrow_cells\n"
        "narrow_cells(np.zeros((9, 9), np.bool_))\n"
        "sys.exit(' '.join(each for each in ('numba', 'llvmlite') if each in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""
