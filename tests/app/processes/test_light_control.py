"""What the control process must not load, nor grow to."""

import subprocess
import sys

import pytest

from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot

HEAVY = (
    "numpy",
    "mcap",
    "zstandard",
    "lz4",
    "numba",
    "scipy",
    "matplotlib",
    "cv2",
    "typer",
    "rich",
    "pydantic",
)


@pytest.mark.parametrize("module", ["robotctl.app.processes.control"])
def test_the_control_process_loads_nothing_heavy(module: str) -> None:
    code = f"import sys, {module}; print(*[m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.split() == []


@pytest.mark.parametrize("name", ["telemetry", "navigation", "recorder", "camera", "lidar"])
def test_no_process_loads_what_checks_files_to_have_its_configuration(name: str) -> None:
    options = StackOptions("robot", str(find_file("diff_drive"))).validated()
    module = f"robotctl.app.processes.{name}"
    code = f"""
import sys, {module}
from robotctl.config.options import options_of_command_line
print(options_of_command_line(sys.argv).load().robot.name, "pydantic" in sys.modules)
"""
    _python, _m, _module, argument = options.command(module)
    done = subprocess.run(
        [sys.executable, "-c", code, argument], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [load_robot(find_file("diff_drive")).robot.name, "False"]
