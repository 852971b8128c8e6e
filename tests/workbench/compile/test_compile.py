"""Compilation ahead of time misses no function, says why it cannot, and leaves nothing running."""

import ast
import re
import sys
import time
from pathlib import Path

import pytest
from numba.core import event

from native_kernels.cache import cache_of
from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.cli import compile as command
from robotctl.config.robot_file import find_file
from robotctl.workbench.compile import compile as work
from robotctl.workbench.compile.compile import CompileError, Kernels
from robotctl.workbench.graphs.optimise import optimise
from robotctl.workbench.graphs.options import OptimiseOptions

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("robotctl", "firmware_sim")


@pytest.fixture
def compiled():
    """Need what the first stage of `make test` makes."""
    if Kernels().missing:
        pytest.skip("nothing is compiled ahead of time here: `robotctl compile` does it")


def declared(package):
    """Return module and name of all functions that are to be compiled."""
    for path in sorted((ROOT / package).rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "@compiled" in text else ():
            if isinstance(node, ast.FunctionDef) and any(
                isinstance(each, ast.Name) and each.id == "compiled" for each in node.decorator_list
            ):
                yield module, node.name


def cached(folder):
    """Return module and name of all functions in a folder of the cache."""
    for path in Path(folder).rglob("*.nbi"):
        yield path.parent.name, re.sub(r"-\w+\.py\d+$", "", path.stem).rpartition(".")[2]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_compiled_function_is_called_by_a_warm_up(compiled, package):
    assert {*declared(package)} <= {*cached(cache_of(package).folder)}


def test_the_sources_tell_how_many_there_are():
    numbers = [len(list(declared(each))) for each in PACKAGES]
    assert [cache_of(each).total for each in PACKAGES] == numbers
    assert Kernels().total == sum(numbers)
    assert Kernels(simulated=False).total == numbers[0]


def test_a_library_is_wanted_where_there_is_none_and_both_compilers_are(monkeypatch):
    found = {"robotctl": Path("library.so")}
    monkeypatch.setattr(work, "found_library", found.get)
    monkeypatch.setenv("CC", sys.executable)
    monkeypatch.setenv("CXX", "no-such-compiler")
    assert not Kernels().lack_library
    monkeypatch.setenv("CXX", sys.executable)
    assert Kernels().lack_library
    found["firmware_sim"] = Path("library.so")
    assert not Kernels().lack_library


class Compiled(event.Listener):
    """Names of our functions that numba compiles."""

    def __init__(self):
        self.names = []

    def on_start(self, event):
        function = event.data["dispatcher"].py_func
        if function.__module__.partition(".")[0] in PACKAGES:
            self.names.append(f"{function.__module__}.{function.__qualname__}")

    def on_end(self, event):
        pass


GRAPH = """\
VERTEX_SE2 0 0 0 0
EDGE_SE2 0 1 1 0 1.57 4 0 0 4 0 25
EDGE_SE2 1 2 1 0 1.57 4 0 0 4 0 25
EDGE_SE2 2 0 1 -1 1.57 4 0 0 4 0 25
EDGE_SE2_XY 0 9 2 1 100 0 100
EDGE_SE2_XY 2 9 -1 0.1 100 0 100
"""


def test_afterwards_an_errand_slam_and_a_graph_compile_nothing(compiled, tmp_path):
    robot, errand = find_file("diff_drive"), find_file("errand", "missions")
    lost = ('localisation.method="mcl"', 'localisation.start="unknown"')
    slam = ('localisation.method="slam"', "localisation.mapping=true")
    graph = tmp_path / "triangle.g2o"
    graph.write_text(GRAPH, encoding="utf-8")
    listener = Compiled()
    event.register("numba:compile", listener)
    try:
        run_lockstep(SimOptions(robot, errand, localisation=lost, max_seconds=8.0))
        run_lockstep(SimOptions(robot, errand, localisation=slam, max_seconds=3.0))
        optimise(OptimiseOptions(graph, marginals=("1",)))
    finally:
        event.unregister("numba:compile", listener)
    assert listener.names == []


def units(folder, monkeypatch, **bodies):
    """Put modules with these bodies of `warm_up` in the place of those of the package."""
    (folder / "warmed").mkdir()
    for name, body in bodies.items():
        text = f"def warm_up():\n    {body}\n"
        (folder / "warmed" / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(work, "_HERE", "warmed")
    monkeypatch.setattr(work, "_BUILDER", "warmed.build")
    monkeypatch.setattr(work, "_ROBOT", tuple(bodies))
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.setattr(cache_of("robotctl"), "folder", str(folder))


def test_all_parts_run_and_then_the_folder_is_marked(tmp_path, monkeypatch):
    made = {f"unit{k}": f"open({str(tmp_path / f'done{k}')!r}, 'w')" for k in range(4)}
    units(tmp_path, monkeypatch, **made)
    kernels, told = Kernels(simulated=False), []
    assert "nothing of these sources is compiled" in kernels.missing
    without = kernels.compile(lambda done, total: told.append((done, total)))
    assert "library of robotctl: its functions cannot be compiled: ModuleNotFoundError" in without
    assert len(list(tmp_path.glob("done*"))) == 4
    assert kernels.missing == ""
    assert {total for _, total in told} == {kernels.total}


def test_a_library_that_a_wheel_brought_is_not_built_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(work, "found_library", {"firmware_sim": Path("library.so")}.get)
    monkeypatch.setattr(cache_of("robotctl"), "folder", str(tmp_path))
    ran = []
    monkeypatch.setattr(work, "_run", lambda units, _watch: ran.extend(units))
    Kernels().compile()
    assert [unit for unit in ran if unit.startswith("library")] == ["library of robotctl"]


def test_another_processor_is_told_so(tmp_path, monkeypatch):
    units(tmp_path, monkeypatch, unit="pass")
    kernels = Kernels(simulated=False)
    kernels.compile()
    monkeypatch.setattr(work, "processor", lambda: "other-1234")
    assert kernels.missing == "they were compiled for another processor than this one, other-1234"
    monkeypatch.setattr(work.os, "access", lambda *_: False)
    with pytest.raises(CompileError, match=r"cannot be written to.*other-1234; run `robotctl comp"):
        kernels.compile()


def test_a_part_that_fails_says_why_and_ends_the_others(tmp_path, monkeypatch):
    slow = f"import os, time; print(os.getpid(), file=open({str(tmp_path / 'pid')!r}, 'w'),"
    slow += " flush=True); time.sleep(600)"
    wait = f"import os, time\n    while not os.path.exists({str(tmp_path / 'pid')!r}):"
    bad = f"{wait} time.sleep(0.01)\n    raise OSError('the disk is gone')"
    monkeypatch.setattr(work.os, "sched_getaffinity", lambda _: {0, 1})
    units(tmp_path, monkeypatch, slow=slow, bad=bad)
    begin_s = time.monotonic()
    with pytest.raises(CompileError, match="bad: its functions cannot be compiled: OSError: the d"):
        Kernels(simulated=False).compile()
    assert time.monotonic() - begin_s < 100.0
    assert not Path("/proc", (tmp_path / "pid").read_text().strip() or "none").exists()
    assert not cache_of("robotctl").is_complete()


def test_where_nothing_can_be_kept_a_robot_starts_all_the_same(monkeypatch, capsys):
    monkeypatch.setattr(cache_of("robotctl"), "folder", "")
    with pytest.raises(CompileError, match="NUMBA_CACHE_DIR=FOLDER"):
        command.compile_all()
    command.compile_missing(simulated=False)
    assert capsys.readouterr() == ("", "")
