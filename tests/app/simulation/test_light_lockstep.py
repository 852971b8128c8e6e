"""What a run in lockstep must not load."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("package", ["zmq", "mcap", "cv2"])
def test_lockstep_without_logs_and_camera_loads_none_of_their_packages(package: str) -> None:
    code = f"import sys, robotctl.app.simulation.lockstep; print({package!r} in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "False\n"
