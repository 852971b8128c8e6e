"""Without the extra `sim` there is nothing to simulate with: a sentence says so."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys
sys.modules["numba"] = None
sys.argv = {arguments!r}
from {module} import main
sys.exit(main())
"""


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("robotctl.cli.main", ["robotctl", "sim", "--lockstep"]),
        ("robotctl.cli.main", ["robotctl", "tune"]),
        (
            "firmware_sim.__main__",
            ["firmware_sim", "--robot=configs/diff_drive.toml", "--world=configs/worlds/flat.toml"],
        ),
    ],
)
def test_a_sentence_names_what_to_install(module, arguments):
    program = PROGRAM.format(module=module, arguments=arguments)
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 2
    assert "pip install 'robotctl[sim]'" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_help_needs_no_compiler():
    program = PROGRAM.format(module="robotctl.cli.main", arguments=["robotctl", "sim", "--help"])
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 0, ended.stderr
