"""What becomes of tests whose recordings are missing (tests/conftest.py)."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

CONFTEST = Path(__file__).resolve().parent.parent / "conftest.py"
TESTS = """
import pytest

@pytest.mark.recordings("walk.csv")
def test_reads_a_walk(recordings):
    assert (recordings / "walk.csv").read_text() == "1"

@pytest.mark.recordings("drive.csv")
def test_reads_a_drive():
    assert True
"""


def run(tmp_path: Path, data: Path) -> str:
    suite = tmp_path / "checkout" / "tests"
    suite.mkdir(parents=True)
    shutil.copy(CONFTEST, suite)
    (suite / "test_recordings.py").write_text(TESTS)
    (suite / "pytest.ini").write_text("[pytest]\nmarkers =\n    recordings: data\n")
    result = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rootdir", suite, suite],
        env={**os.environ, "ROBOTCTL_DATA": str(data)},
        capture_output=True,
        text=True,
        cwd=suite,
        check=False,
    )
    assert result.returncode == 0, result.stdout
    return result.stdout


def test_without_the_folder_each_test_not_run_is_named(tmp_path: Path) -> None:
    output = run(tmp_path, tmp_path / "nowhere")
    assert "2 skipped" in output
    for name in ("test_reads_a_walk", "test_reads_a_drive"):
        line = f"not run, recordings missing: {tmp_path / 'nowhere'}: test_recordings.py::{name}"
        assert line in output


def test_only_the_test_whose_recording_is_missing_does_not_run(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "walk.csv").write_text("1")
    output = run(tmp_path, tmp_path / "data")
    assert "1 passed, 1 skipped" in output
    assert "drive.csv: test_recordings.py::test_reads_a_drive" in output
