"""The guest tool before it boots anything: arguments, where scenes begin, the debugger's words."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import os
import re
import socket
import subprocess
import sys
import threading
from pathlib import Path
from types import ModuleType

import pytest

from arm_guest_controller import Debugger

TOOL = Path(__file__).resolve().parents[2] / "tools" / "arm-guest"


def load() -> ModuleType:
    loader = importlib.machinery.SourceFileLoader("arm_guest", str(TOOL))
    spec = importlib.util.spec_from_loader("arm_guest", loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
    sys.modules["arm_guest"] = module
    loader.exec_module(module)
    sys.dont_write_bytecode = before
    return module


guest = load()


def test_an_unknown_scene_is_refused_with_those_that_there_are() -> None:
    command = [sys.executable, TOOL, "--scenes", "kiled"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "kiled: no such scene; there are install, link, start, patrol, killed" in done.stderr


def test_a_library_is_not_made_of_kernels_of_which_some_are_not_compiled(tmp_path: Path) -> None:
    command = [sys.executable, TOOL.with_name("foreign_kernels.py"), "aarch64", tmp_path / "made"]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "empty")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 1
    assert "empty" in done.stderr
    assert "run `make setup` first" in done.stderr
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("kept", "asked", "played", "disk"),
    [
        ([], ["install", "link"], ["install", "link"], None),
        ([], ["link"], ["install", "link"], None),
        (["install"], ["start"], ["start"], "install"),
        ([], ["killed"], ["install", "start", "killed"], None),
        (["install"], ["killed"], ["start", "killed"], "install"),
        (["install", "start"], ["killed"], ["killed"], "start"),
    ],
)
def test_scenes_begin_with_the_disk_that_is_kept_or_with_what_they_need(
    tmp_path: Path, kept: list[str], asked: list[str], played: list[str], disk: str | None
) -> None:
    disks = {name: tmp_path / name for name in ("install", "start")}
    for name in kept:
        disks[name].touch()
    assert guest.begun(asked, disks) == (played, disks[disk] if disk else None)


def test_the_debugger_takes_no_word_of_the_stop_for_an_answer(tmp_path: Path) -> None:
    answers = {b"?": b"T05", b"D": b"OK", b"p4": b"0300000000000000", b"m10,5": b"63616e3000"}
    answers[b"qXfer:features:read:target.xml:0,ffb"] = b"l<target/>"
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(tmp_path / "debugger"))
    listener.listen(1)

    def serve() -> None:
        connection, _ = listener.accept()
        with listener, connection:
            connection.sendall(b"$T02thread:01;#04")
            heard = b""
            while data := connection.recv(4096):
                heard += data
                while packet := re.match(rb"\+*\$([^#]*)#([0-9a-f]{2})", heard):
                    heard = heard[packet.end() :]
                    request, checksum = packet.groups()
                    assert int(checksum, 16) == sum(request) % 256
                    answer = answers[request]
                    connection.sendall(b"+$%s#%02x" % (answer, sum(answer) % 256))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    debugger = Debugger(tmp_path / "debugger")
    assert debugger.register(4) == 3
    assert debugger.memory(0x10, 5) == b"can0\0"
    debugger.go_on()
    thread.join(5.0)
    assert not thread.is_alive()
