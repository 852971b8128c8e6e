"""What the control process must not load, nor grow to."""

import subprocess
import sys

import pytest

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
)


@pytest.mark.parametrize("module", ["robotctl.app.processes.control"])
def test_the_control_process_loads_nothing_heavy(module: str) -> None:
    code = f"import sys, {module}; print(*[m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.split() == []
