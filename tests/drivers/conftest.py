"""The DBC once for us and once for cantools, the oracle, and a clock that tests set."""

from __future__ import annotations

from pathlib import Path

import cantools.database
import pytest

from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import load_dbc
from robotctl.drivers.can.nodes.robot_codec import RobotCodec
from robotctl.runtime.clock import VirtualClock

ROBOT_DBC = Path(__file__).parents[2] / "configs" / "robot.dbc"


@pytest.fixture(scope="session")
def dbc():
    return load_dbc(ROBOT_DBC)


@pytest.fixture(scope="session")
def oracle():
    return cantools.database.load_file(ROBOT_DBC)


@pytest.fixture(scope="session")
def codec(dbc):
    return RobotCodec(dbc)


@pytest.fixture
def clock():
    return VirtualClock(1_000_000_000)


@pytest.fixture
def parameters():
    return NodeParameters(
        rate_hz=200,
        command_timeout_ms=100,
        heartbeat_timeout_ms=350,
        sonars=8,
    )


@pytest.fixture
def edited_dbc(tmp_path):
    """Write robot.dbc with some text replaced, and return its path."""

    def write(*replacements):
        text = ROBOT_DBC.read_text(encoding="cp1252")
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / "edited.dbc"
        path.write_text(text, encoding="cp1252")
        return path

    return write
