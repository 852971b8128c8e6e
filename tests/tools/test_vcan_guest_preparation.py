"""The guest tool before it boots anything: arguments, kernel names, packages."""

from __future__ import annotations

import hashlib
import importlib.machinery
import importlib.util
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import ModuleType

import pytest

TOOL = Path(__file__).resolve().parents[2] / "tools" / "vcan-guest"


def load() -> ModuleType:
    loader = importlib.machinery.SourceFileLoader("vcan_guest", str(TOOL))
    spec = importlib.util.spec_from_loader("vcan_guest", loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
    loader.exec_module(module)
    sys.dont_write_bytecode = before
    return module


guest = load()


@pytest.fixture
def machine_without_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """No kernel source and no program on the path; the folder of programs is returned."""
    programs = tmp_path / "bin"
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs))
    monkeypatch.setenv("ROBOTCTL_LINUX_SOURCE", str(tmp_path / "none.tar.xz"))
    return programs


def test_options_end_at_the_command() -> None:
    parsed = guest.parse(["--real-time", "--memory", "512", "ls", "--real-time", "-h"])
    assert parsed == (True, 512, ["ls", "--real-time", "-h"])


def test_virtual_time_is_the_default() -> None:
    assert guest.parse(["--", "--odd-name"]) == (False, 2048, ["--odd-name"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no command"),
        (["--realtime", "ls"], "--realtime: unknown option; allowed: --real-time, --memory"),
        (["--memory"], "--memory takes"),
        (["--memory", "1G", "ls"], "--memory takes"),
        (["--memory", "127", "ls"], "--memory takes a whole number of MiB from 128"),
    ],
)
def test_a_wrong_command_line_exits_2_and_says_why(arguments: list[str], message: str) -> None:
    result = subprocess.run(
        [sys.executable, TOOL, *arguments], capture_output=True, text=True, check=False
    )
    assert result.returncode == 2
    assert message in result.stderr
    assert "usage:" in result.stderr
    assert not result.stdout


def test_help_names_every_option() -> None:
    result = subprocess.run([sys.executable, TOOL, "--help"], capture_output=True, check=True)
    assert b"--real-time" in result.stdout
    assert b"--memory" in result.stdout


def test_another_configuration_is_another_kernel_of_any_version() -> None:
    one, other = guest.kernel_pattern("CONFIG_A=y"), guest.kernel_pattern("CONFIG_A=n")
    digest = hashlib.sha256(b"CONFIG_A=y").hexdigest()[:12]
    assert one == f"linux-*-{os.uname().machine}-{digest}"
    assert one != other


def test_the_newest_cached_kernel_that_starts_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    pattern = guest.kernel_pattern(guest.CONFIG.read_text())
    folder = guest.cache_directory()
    folder.mkdir(parents=True)
    for age, version in enumerate(("6.1.192", "6.1.187")):
        kernel = folder / pattern.replace("*", version)
        kernel.write_text("#!/bin/sh\necho 6.1\n")
        kernel.chmod(0o755)
        os.utime(kernel, (1e9 - age, 1e9 - age))
    assert guest.kernel().name == pattern.replace("*", "6.1.192")
    assert not list(folder.glob("build-*"))


def test_a_cached_kernel_that_does_not_start_is_built_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    pattern = guest.kernel_pattern(guest.CONFIG.read_text())
    folder = guest.cache_directory()
    folder.mkdir(parents=True)
    (folder / pattern.replace("*", "6.1")).write_text("of another machine")
    (folder / "build-left").mkdir()
    built = tmp_path / "built"
    monkeypatch.setattr(os, "uname", lambda: os.uname_result(("", "", "", "", "x86_64")))
    monkeypatch.setattr(guest, "kernel_pattern", lambda _: pattern)
    monkeypatch.setattr(guest, "source_archive", lambda: tmp_path / "linux.tar.xz")
    monkeypatch.setattr(guest, "build", lambda *_: built)
    assert guest.kernel() == built
    assert not (folder / "build-left").exists(), "what a killed builder left is removed"


def test_a_second_builder_waits_for_the_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order: list[str] = []

    def second() -> None:
        with guest._lock(tmp_path / "lock"):
            order.append("second")

    with guest._lock(tmp_path / "lock"):
        thread = threading.Thread(target=second)
        thread.start()
        thread.join(0.2)
        order.append("first")
    thread.join(10)
    assert order == ["first", "second"]
    assert "waiting for another builder" in capsys.readouterr().err


@pytest.mark.usefixtures("machine_without_packages")
def test_every_missing_package_is_named() -> None:
    wanted = ["linux-source-6.1", "flex", "bison", "bc", "make", "gcc", "tar", "xz-utils"]
    assert guest.missing_packages() == wanted


def test_what_is_there_is_not_asked_for(machine_without_packages: Path, tmp_path: Path) -> None:
    (tmp_path / "none.tar.xz").touch()
    for name in ("flex", "make", "gcc", "tar", "xz"):
        program = machine_without_packages / name
        program.touch()
        program.chmod(0o755)
    assert guest.missing_packages() == ["bison", "bc"]


@pytest.mark.usefixtures("machine_without_packages")
def test_without_root_or_apt_the_command_to_install_is_said() -> None:
    with pytest.raises(guest.GuestError) as failure:
        guest.install(["flex", "bison"])
    assert "apt-get update && apt-get install -y" in str(failure.value)
    assert str(failure.value).endswith("flex bison")


def test_a_failing_step_of_the_build_shows_the_end_of_its_log(tmp_path: Path) -> None:
    with pytest.raises(guest.GuestError) as failure:
        guest._watch(["sh", "-c", "echo no such symbol; exit 4"], tmp_path, "configuring", 0.0)
    assert "configuring failed (status 4):\nno such symbol" in str(failure.value)
