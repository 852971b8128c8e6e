from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from tests.app.test_mapping import write_log
from tests.cli.command import status_of


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
