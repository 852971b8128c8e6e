"""Options and fixtures of the hardware-in-the-loop tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hil_tests.rig import Rig


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--bus", default="simcan", help="simcan, vcan0 or can0")


@pytest.fixture(scope="session")
def bus(request: pytest.FixtureRequest) -> str:
    return str(request.config.getoption("--bus"))


@pytest.fixture
def make_rig(bus: str, tmp_path: Path) -> Iterator[Callable[..., Rig]]:
    """Makes benches; at the end no node may have rejected a frame."""
    rigs: list[Rig] = []

    def make(**kwargs: str) -> Rig:
        rigs.append(Rig(bus, tmp_path, **kwargs))
        return rigs[-1]

    yield make
    for rig in rigs:
        try:
            rejected = rig.rejected_frames()
        finally:
            rig.close()
        assert rejected == dict.fromkeys(rejected, 0), "the drive rejected frames"


@pytest.fixture
def rig(make_rig: Callable[..., Rig]) -> Rig:
    """The firmware on the bus, nothing else."""
    rig = make_rig()
    rig.start_firmware()
    return rig


@pytest.fixture
def armed(rig: Rig) -> Rig:
    """Firmware and control process, armed."""
    rig.start()
    rig.arm()
    return rig
