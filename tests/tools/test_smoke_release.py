"""The verdict of the trials of a release, and what its recipes must agree on."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tools.smoke_release import (
    CAN_LOG,
    RELEASES,
    Expected,
    FailedError,
    NotRunError,
    check,
    tried,
)

ROOT = Path(__file__).resolve().parents[2]
FRAMES = b"(0.005000) can0 101#00\n"
EXPECTED = Expected("0.1.0", hashlib.sha256(FRAMES).hexdigest())
KEPT = "457 functions compiled already, kept in /opt/robotctl/lib/python3.11/site-packages/robotctl"


def write_trial(out: Path) -> None:
    """Write what a trial of a good artefact finds."""
    (out / "record").mkdir()
    (out / CAN_LOG).write_bytes(FRAMES)
    (out / "version").write_text("0.1.0\n")
    (out / "compile").write_text(KEPT)
    (out / "compiled").write_text("")
    findings = [{"check": "configuration", "verdict": "ok"}, {"check": "CAN", "verdict": "fail"}]
    (out / "doctor").write_text(json.dumps({"fit": False, "findings": findings}))


def test_an_artefact_that_does_as_the_checkout_passes(tmp_path: Path) -> None:
    write_trial(tmp_path)
    check(tmp_path, EXPECTED)


@pytest.mark.parametrize(
    ("file", "text", "reason"),
    [
        ("version", "0.0.9\n", "its version is 0.0.9, not 0.1.0"),
        ("compile", "457 functions compiled in 30 s, kept in /root/.cache", "not those of the"),
        ("compile", "457 functions compiled already, kept in /root/.cache", "not those of the"),
        ("compiled", "/root/.cache/robotctl/x.nbi\n", "it has compiled: /root/.cache"),
        ("doctor", '{"findings": [{"check": "configuration", "verdict": "fail"}]}', "doctor"),
        ("doctor", "Traceback", "found too little"),
        (CAN_LOG, "(0.005000) can0 101#01\n", "that of the checkout"),
    ],
)
def test_what_differs_is_named(tmp_path: Path, file: str, text: str, reason: str) -> None:
    write_trial(tmp_path)
    (tmp_path / file).write_text(text)
    with pytest.raises(FailedError, match=reason):
        check(tmp_path, EXPECTED)


def test_a_drive_without_a_can_log_fails(tmp_path: Path) -> None:
    write_trial(tmp_path)
    (tmp_path / CAN_LOG).unlink()
    with pytest.raises(FailedError, match="found too little"):
        check(tmp_path, EXPECTED)


def lacking(_folder: Path, _out: Path) -> None:
    """Find no podman."""
    raise NotRunError("podman is not installed")


def silent(_folder: Path, _out: Path) -> None:
    """Find nothing."""


@pytest.mark.parametrize(
    ("trial", "line", "good"),
    [
        (lambda _, out: write_trial(out), "it: passed, CAN log", True),
        (lacking, "it: not run: podman is not installed", True),
        (silent, "it: failed: the trial found too little", False),
    ],
)
def test_each_artefact_has_one_line(
    trial: Callable[[Path, Path], None],
    line: str,
    good: bool,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert tried("it", trial, EXPECTED) is good
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 1
    assert said[0].startswith(line)


def test_the_image_is_of_the_debian_whose_python_the_project_needs() -> None:
    (base,) = re.findall(
        r"^ARG BASE=(\S+)$", (ROOT / "packaging" / "Dockerfile").read_text(), re.MULTILINE
    )
    (least,) = re.findall(
        r'^requires-python = ">=(\S+)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE
    )
    assert f"BASE ?= {base}\n" in (ROOT / "Makefile").read_text()
    assert base.endswith(":12-slim")
    assert RELEASES[f"python{least}"] == "bookworm"


def test_the_container_starts_as_the_service_does() -> None:
    image = (ROOT / "packaging" / "Dockerfile").read_text()
    unit = (ROOT / "configs" / "systemd" / "robotctl.service").read_text()
    for words in ("/usr/bin/env", "--block-signal=USR1", "run", "--robot", "--record"):
        assert f'"{words}"' in image
        assert f"{words} " in unit
    assert "USER 10001\n" in image
