from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from tests.cli.command import status_of
from tests.workbench.localise.test_mapping import write_log


def test_the_command_writes_both_files_and_says_what_they_hold(tmp_path):
    log = write_log(tmp_path / "room.log")
    prefix = tmp_path / "room"
    arguments = ["map", "--log", str(log), "--scans", "even", "--out", str(prefix)]
    result = CliRunner().invoke(app, [*arguments, "--resolution", "0.1"])
    assert result.exit_code == 0, result.output
    assert "12 of 24 scans (even), at reference poses" in result.output
    assert "cells of 0.1 m" in result.output
    assert "coverage: 1" in result.output
    assert "entropy: " in result.output
    assert (tmp_path / "room.yaml").is_file()
    assert (tmp_path / "room.pgm").is_file()


def test_a_folder_is_no_prefix_and_nothing_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in (".", "..", "/", tmp_path):
        assert status_of("map", "--log", tmp_path / "no.log", "--out", folder) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"robotctl: --out {folder}: is a folder; give a PREFIX, such as ")
    assert list(tmp_path.iterdir()) == []


def test_a_name_of_one_of_the_files_is_the_prefix_of_both(tmp_path):
    log = write_log(tmp_path / "room.log")
    for name in ("m.pgm", "n.yaml", "v1.2"):
        words = ["map", "--log", str(log), "--out", str(tmp_path / name)]
        assert CliRunner().invoke(app, words).exit_code == 0
    names = {path.name for path in tmp_path.iterdir()} - {"room.log"}
    assert names == {"m.pgm", "m.yaml", "n.pgm", "n.yaml", "v1.2.pgm", "v1.2.yaml"}
    assert 'image: "m.pgm"' in (tmp_path / "m.yaml").read_text()


def test_the_origin_is_told_to_the_millimetre_and_written_without_stray_digits(tmp_path):
    log = write_log(tmp_path / "room.log")
    words = ["map", "--log", str(log), "--out", str(tmp_path / "m"), "--resolution", "0.025"]
    result = CliRunner().invoke(app, words)
    x, y = re.search(r"from \((-?\d+\.\d{3}), (-?\d+\.\d{3})\) m", result.output).groups()
    origin = re.search(r"origin: \[(.*), (.*), 0.0\]", (tmp_path / "m.yaml").read_text()).groups()
    assert [float(word) for word in origin] == pytest.approx([float(x), float(y)], abs=5e-4)
    assert all(len(word) < 10 for word in origin)


def test_a_campus_is_mapped_in_little_memory(tmp_path):
    log = tmp_path / "campus.log"
    rng = np.random.default_rng(3)
    with log.open("w") as file:
        for i, at in enumerate(np.linspace(0.0, 2.0 * np.pi, 800)):
            x, y = 350.0 * np.cos(at), 250.0 * np.sin(at)
            ranges = " ".join(f"{value:.2f}" for value in rng.uniform(2.0, 28.0, 180))
            file.write(f"FLASER 180 {ranges} {x} {y} {at} {x} {y} {at} {10 + 3 * i} h 0\n")
    words = [sys.executable, "-m", "robotctl", "map", "--log", log, "--out", tmp_path / "campus"]
    measure = (
        "import resource, subprocess, sys; done = subprocess.run(sys.argv[1:]); "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, done.returncode)"
    )
    done = subprocess.run(
        [sys.executable, "-c", measure, *map(str, words)],
        capture_output=True,
        text=True,
        check=True,
    )
    peak_kb, status = map(int, done.stdout.split()[-2:])
    assert status == 0, done.stderr
    size = re.search(r"size: ([\d.]+) m x ([\d.]+) m", done.stdout).groups()
    assert [float(word) for word in size] == pytest.approx([750.0, 550.0], abs=15.0)
    assert peak_kb < 400_000
