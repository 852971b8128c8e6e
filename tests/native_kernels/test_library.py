"""Kernels out of the library do what the Python functions do, and need no numba for it."""

import copy
import pickle
import subprocess
import sys
import types
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from native_kernels.by_numba import dispatcher_of
from native_kernels.cache import cache_of
from native_kernels.library import native_kernel, native_library
from robotctl.estimation.slam.linear.assembly import pair_assembler

PACKAGES = ("robotctl", "firmware_sim")
if not all(map(native_library, PACKAGES)):
    pytest.skip("no library of kernels here: `robotctl compile` builds it", allow_module_level=True)
KERNELS = tuple(native_library(each).Kernel for each in PACKAGES)

RNG = np.random.default_rng(5)
CLOUD = RNG.uniform(-1.0, 1.0, (40, 2))
CELLS = RNG.integers(0, 2, (30, 40), np.uint8)


def kernel(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def test_to_know_that_nothing_is_missing_loads_no_compiler() -> None:
    code = """
import sys
from robotctl.cli.compile import compile_missing
compile_missing(simulated=True)
assert not {"numba", "llvmlite"} & sys.modules.keys()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


CALLS: list[tuple[str, tuple[Any, ...]]] = [
    (
        "robotctl.estimation.ranging.range_casting:_largest_squares",
        (RNG.integers(0, 2, (30, 40), np.uint8),),
    ),
    ("robotctl.planning.path.global_planning.trees.sampling:narrow_cells", (CLOUD > 0.4,)),
    ("robotctl.planning.path.global_planning.curves:_three_turns", (0.3, 1.2, -0.4, True)),
    ("robotctl.estimation.slam.incremental.bayes_tree:grown_ints", (np.arange(9), 3, 4)),
]


@pytest.mark.parametrize(("place", "arguments"), CALLS, ids=[place for place, _ in CALLS])
def test_a_kernel_gives_what_its_function_gives(place: str, arguments: tuple[Any, ...]) -> None:
    function = kernel(place)
    assert isinstance(function, KERNELS)
    mine, theirs = copy.deepcopy(arguments), copy.deepcopy(arguments)
    result, expected = function(*mine), function.py_func(*theirs)
    np.testing.assert_allclose(numbers(result, *mine), numbers(expected, *theirs), rtol=1e-12)


def numbers(*values: Any) -> Any:
    """Return all numbers in a row."""
    return np.hstack([np.ravel(each) for each in values if each is not None]).astype(float)


@pytest.mark.parametrize("package", PACKAGES)
def test_all_kernels_are_in_the_library(package: str) -> None:
    found = {each: kernel(each) for each in cache_of(package).digests}
    made = (native_library(package).Kernel, type(pair_assembler))
    assert [each for each, value in found.items() if not isinstance(value, made)] == []


def test_a_kernel_within_a_function_is_in_the_library() -> None:
    assert isinstance(pair_assembler(3, 3, 3), KERNELS)


NARROW = "robotctl.planning.path.global_planning.trees.sampling:narrow_cells"


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
    inner = kernel("robotctl.planning.path.global_planning.curves:_three_turns")
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


CODES = {
    "a kernel": """
import numpy as np
from robotctl.planning.path.global_planning.trees.sampling import narrow_cells
narrow_cells(np.zeros((9, 9), np.bool_))
""",
    "lockstep": """
from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
robot, errand = find_file("diff_drive"), find_file("errand", "missions")
run_lockstep(SimOptions(robot, errand, max_seconds=1.0))
""",
    "the simulator as a process": """
from firmware_sim.__main__ import main
main(["--robot=diff_drive", "--world=flat", "--bus=simcan:CHANNEL", "--duration=0.3"])
""",
}


@pytest.mark.parametrize("name", CODES)
def test_with_the_library_no_numba_is_loaded(name: str, tmp_path: Path) -> None:
    code = (
        f"import sys\n{CODES[name].replace('CHANNEL', str(tmp_path / 'bus'))}\n"
        "sys.exit(' '.join(each for each in ('numba', 'llvmlite') if each in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_without_the_library_the_simulator_does_the_same_by_numba(tmp_path: Path) -> None:
    code = """
import sys
from native_kernels import library
if sys.argv[1] == "numba":
    library.native_library = lambda _: None  # as where there is none
from firmware_sim.plant.axis import Mode
from robotctl.app.simulation.lockstep_stack import make_simulation
from robotctl.config.robot_file import find_file
simulation = make_simulation(
    find_file("diff_drive"), find_file("flat", "worlds"), 3, None, people=1
)
plant = simulation.plant
plant.axes[0].command(Mode.DUTY, 0.5)
simulation.advance(300_000_000)
print(plant.x_m, plant.theta_rad, plant.battery_current_a, simulation.scan())
print("numba" in sys.modules)
"""
    told = [
        subprocess.run(
            [sys.executable, "-c", code, how], capture_output=True, text=True, check=True
        ).stdout.splitlines()
        for how in ("library", "numba")
    ]
    assert told[0][:-1] == told[1][:-1]
    assert [each[-1] for each in told] == ["False", "True"]
