"""The real processes of a robot on a simulated bus without nodes."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.supervision.bench import Ear, wait


@pytest.fixture(scope="module")
def channel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    name = str(tmp_path_factory.mktemp("bus") / "hub")
    command = [sys.executable, "-m", "firmware_sim.bus", "--channel", name, "--ack"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as hub:
        wait(Path(name).exists, "the bus is there")
        yield name
        hub.terminate()


@pytest.fixture
def ear(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Ear]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("run")))
    made = Ear("robot")
    yield made
    made.context.destroy(linger=0)
