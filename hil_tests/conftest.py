"""Options and fixtures of the hardware-in-the-loop tests."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hil_tests.ground_station import GroundStation
from hil_tests.rig import Rig
from robotctl.app.config import find_file
from robotctl.app.stack import CONTROL, NAVIGATION, TELEMETRY
from robotctl.runtime.messages import SafetyState


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--bus", default="simcan", help="simcan, vcan0 or can0")
    parser.addoption("--reactions", default="", help="append each reaction time to this file")


@pytest.fixture(scope="session")
def bus(request: pytest.FixtureRequest) -> str:
    return str(request.config.getoption("--bus"))


def close(rig: Rig) -> None:
    """End a bench; no frame was rejected on it and no motion was unsafe."""
    try:
        rig.listen()
        rejected = rig.rejected_frames()
    finally:
        rig.close()
    if rig.truth is not None:
        assert rig.truth.unsafe_motions == 0, rig.truth.unsafe_reason
    if not rig.tolerates_rejects:
        assert rejected == dict.fromkeys(rejected, 0), "the drive rejected frames"


@pytest.fixture
def make_rig(bus: str, tmp_path: Path) -> Iterator[Callable[..., Rig]]:
    """Makes benches for one test."""
    rigs: list[Rig] = []

    def make(**kwargs: str) -> Rig:
        rigs.append(Rig(bus, tmp_path, **kwargs))
        return rigs[-1]

    yield make
    for rig in rigs:
        close(rig)


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


@pytest.fixture(scope="module")
def benches() -> Iterator[list[Rig]]:
    """The bench that the tests of a module share, once there is one."""
    shared: list[Rig] = []
    yield shared
    for rig in shared:
        close(rig)


@pytest.fixture
def lasting(
    bus: str, benches: list[Rig], tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[Rig]:
    """Firmware and control process, armed, away from walls, with many faults behind them.

    A failed test ends them, so that the next one has new ones.
    """
    if not benches:
        benches.append(Rig(bus, tmp_path))
        benches[0].tolerates_rejects = True
        benches[0].start_firmware()
        benches[0].start()
    rig = benches[0]
    failed_before = request.session.testsfailed
    sound = False
    try:
        rig.arm()
        rig.drive_to_the_middle()
        sound = True
        yield rig
        rig.listen()
        sound = rig.truth.unsafe_motions == 0
        assert sound, rig.truth.unsafe_reason
    finally:
        if not sound or request.session.testsfailed > failed_before:
            benches.pop().close()


@pytest.fixture
def mission_rig(make_rig: Callable[..., Rig], tmp_path: Path) -> Rig:
    """The firmware in the flat, and all that is needed to drive the patrol."""
    rig = make_rig(
        world="flat",
        start="1.0,1.0,0",
        mission=str(find_file("patrol", "missions").resolve()),
        record=str(tmp_path / "record"),
    )
    rig.start_firmware()
    return rig


@pytest.fixture
def reaction(request: pytest.FixtureRequest, bus: str) -> Callable[[str, float], None]:
    """Notes how long a reaction took [ms]; `tools/soak.py` makes a table of the file."""
    file = str(request.config.getoption("--reactions"))

    def note(fault: str, milliseconds: float) -> None:
        line = json.dumps({"fault": fault, "bus": bus, "ms": round(milliseconds, 3)})
        if file:
            with Path(file).open("a", encoding="utf-8") as output:
                output.write(line + "\n")

    return note


@pytest.fixture
def station(make_rig: Callable[..., Rig]) -> Iterator[GroundStation]:
    """A ground station connected to the whole stack in standby."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    rig = make_rig(mavlink_url=f"tcpin:127.0.0.1:{port}")
    rig.start_firmware()
    for module in (CONTROL, NAVIGATION, TELEMETRY):
        rig.start(module)
    rig.wait_for_state(SafetyState.STANDBY)
    station = GroundStation(rig, port)
    station.wait("HEARTBEAT", seconds=10)
    yield station
    station.link.close()
