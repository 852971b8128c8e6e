"""Options and fixtures of the hardware-in-the-loop tests."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import time
from collections.abc import Callable, Generator, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import pytest

from hil_tests.floods import calm
from hil_tests.ground_station import GroundStation
from hil_tests.pauses import PauseWitness
from hil_tests.rig import GUEST_TIME, PATIENT_S, Rig, UnsafeMotionError, is_exact
from robotctl.app.supervision.stack import CONTROL, NAVIGATION, TELEMETRY
from robotctl.config.robot_file import find_file
from robotctl.messages.control import SafetyState

if TYPE_CHECKING:
    from xdist.workermanage import WorkerController


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--bus", default="simcan", help="simcan, vcan0 or can0")
    parser.addoption("--seed", type=int, default=0, help="of the simulated robot and of moments")
    parser.addoption("--reactions", default="", help="append each reaction time to this file")


RERUN_LATER = {"reruns": 3, "reruns_delay": 5, "reruns_delay_backoff_factor": 3}
"""How often, and when [s]: a machine that stands may do so for a minute."""
STOOD = "stood_ms"
PRIORITY = 1
"""Of the tests, where permitted: below the robot."""
WITNESS = pytest.StashKey[PauseWitness]()
BEGAN = pytest.StashKey[int]()
BENCHES = pytest.StashKey[list[Rig]]()
"""Those that a test has had, in the end to be asked what they know of its failure."""
FAILED, UNSAFE = pytest.StashKey[bool](), pytest.StashKey[bool]()
"""Whether a test failed; whether the simulator's monitor saw an unsafe motion meanwhile."""
STOOD_MS = pytest.StashKey[float]()
"""For how long the machine stood while a test failed [ms]; 0: not at all."""
DEAD = pytest.StashKey[dict[str, str]]()
"""The processes of tests that did not end by themselves, and what is known of it."""


def pytest_configure(config: pytest.Config) -> None:
    config.stash[DEAD] = {}
    controls_workers = config.getoption("numprocesses", None) and not hasattr(config, "workerinput")
    if not controls_workers and not is_exact(config.getoption("--bus")):
        config.stash[WITNESS] = PauseWitness()


def pytest_collection_finish() -> None:
    """Let the tests come before ordinary tasks: a driver must not wait while others start."""
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))


def pytest_unconfigure(config: pytest.Config) -> None:
    if WITNESS in config.stash:
        config.stash[WITNESS].close()


def says_nothing(item: pytest.Item) -> bool:
    """Return whether a failure is the machine's: it stood, and nothing unsafe was seen."""
    return item.stash[STOOD_MS] > 0.0 and not item.stash[UNSAFE]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A test that failed while the machine stood says nothing: it is run again."""
    for item in items:
        item.add_marker(pytest.mark.flaky(**RERUN_LATER, condition=partial(says_nothing, item)))


def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[BEGAN], item.stash[STOOD_MS] = time.monotonic_ns(), 0.0
    item.stash[FAILED] = item.stash[UNSAFE] = False
    item.stash[BENCHES] = []


def is_unsafe(error: BaseException | None) -> bool:
    """Return whether an unsafe motion is in an error, in its group, or before it."""
    if error is None:
        return False
    parts = error.exceptions if isinstance(error, BaseExceptionGroup) else ()
    return isinstance(error, UnsafeMotionError) or any(
        map(is_unsafe, (error.__cause__, error.__context__, *parts))
    )


@pytest.hookimpl(wrapper=True, trylast=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Note what speaks for a further run, and against it.

    As the innermost wrapper, since the plugin that runs tests again asks in one of its own.
    """
    report = yield
    if report.failed:
        item.stash[UNSAFE] |= is_unsafe(call.excinfo and call.excinfo.value)
        if not item.stash[FAILED]:  # what fails behind that may be its doing
            item.stash[FAILED] = True
            for rig in item.stash[BENCHES] if report.when != "teardown" else ():  # it ends them
                rig.listen()
                report.sections.append(("robot", f"{rig.told()}\n{rig.history()}"))
            witness = item.config.stash.get(WITNESS, None)
            if witness is not None:
                item.stash[STOOD_MS] = witness.longest_ms(item.stash[BEGAN])
        report.user_properties.append((STOOD, item.stash[STOOD_MS]))
    return report


@pytest.hookimpl(trylast=True, optionalhook=True)
def pytest_handlecrashitem(report: pytest.TestReport) -> None:
    """Let a test whose process died have failed, whatever may be made of it by a further run."""
    report.outcome = "failed"


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: WorkerController, error: object | None) -> None:
    if error is not None:
        node.config.stash[DEAD][node.gateway.id] = str(error)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run of which a process died, though no test was in it."""
    if session.config.stash[DEAD] and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def short(report: pytest.TestReport) -> str:
    """Return the first line of what a failed test said, and where it did."""
    crash = getattr(report.longrepr, "reprcrash", None)
    where = f"{Path(crash.path).name}:{crash.lineno}: " if crash else ""
    said = str(crash.message if crash else report.longrepr)
    return where + said.partition("\n")[0]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which tests were run again and why, which were not run, and which processes died."""
    for report in terminalreporter.stats.get("rerun", []):
        stood_ms = dict(report.user_properties)[STOOD]
        why = f"the machine stood for {stood_ms:.0f} ms; {short(report)}"
        terminalreporter.line(f"RUN AGAIN {report.nodeid}: {why}")
    for report in terminalreporter.stats.get("skipped", []):
        reason = str(report.longrepr[2]).removeprefix("Skipped: ")
        if reason.startswith("not run, "):
            terminalreporter.line(f"{reason}: {report.nodeid}")
    for worker, error in terminalreporter.config.stash[DEAD].items():
        terminalreporter.line(f"FAILED worker {worker}: {error}")


@pytest.fixture(scope="session")
def bus(request: pytest.FixtureRequest) -> str:
    return str(request.config.getoption("--bus"))


def close(rig: Rig) -> None:
    """End a bench: all ended well, none of its frames was rejected.

    Whatever else went wrong, no motion was unsafe.
    """
    rejected: dict[str, int] = {}
    with contextlib.ExitStack() as afterwards:
        afterwards.callback(rig.assert_safe)
        afterwards.callback(rig.close)
        afterwards.callback(rig.listen)
        ends = rig.close_stack()  # the host reads by the same SDO channel
        if not rig.tolerates_rejects:
            rejected = rig.rejected_frames()
    assert not any(ends.values()), ends
    assert rejected == dict.fromkeys(rejected, 0), "the drive rejected frames"


@pytest.fixture(scope="session")
def seed(request: pytest.FixtureRequest) -> int:
    return int(request.config.getoption("--seed"))


Bench: TypeAlias = Rig | GroundStation


def rig_of(bench: Bench) -> Rig:
    return bench.rig if isinstance(bench, GroundStation) else bench


def end_all(benches: list[Bench]) -> None:
    """End the benches that tests share."""
    while benches:
        bench = benches.pop()
        if isinstance(bench, GroundStation):
            bench.link.close()
        close(rig_of(bench))


@pytest.fixture(scope="module")
def benches() -> Iterator[list[Bench]]:
    """The bench that the tests of a module share, once there is one."""
    shared: list[Bench] = []
    yield shared
    end_all(shared)


@contextlib.contextmanager
def shared(benches: list[Bench], request: pytest.FixtureRequest) -> Iterator[None]:
    """Let a test have the shared bench; one that fails ends it, so that the next has a new one."""
    rig = rig_of(benches[0])
    sound = False
    try:
        yield
        rig.listen()
        rig.assert_safe()
        sound = True
    finally:
        if not sound or request.node.stash[FAILED]:
            end_all(benches)


@pytest.fixture
def make_rig(
    bus: str, seed: int, tmp_path: Path, benches: list[Bench], request: pytest.FixtureRequest
) -> Iterator[Callable[..., Rig]]:
    """Makes benches for one test; on a real bus there is room for one, so it ends the shared one.

    Tests with benches of their own stand in front of those that share one.
    """
    with contextlib.ExitStack() as afterwards:

        def make(**kwargs: str) -> Rig:
            end_all(benches)
            rig = Rig(bus, tmp_path, seed, **kwargs)
            afterwards.callback(close, rig)
            request.node.stash[BENCHES].append(rig)
            return rig

        yield make


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


@pytest.fixture
def lasting(
    bus: str, seed: int, benches: list[Bench], tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[Rig]:
    """Firmware and control process, armed, away from walls, with many faults behind them."""
    if not (benches and isinstance(benches[0], Rig)):
        end_all(benches)
        benches.append(Rig(bus, tmp_path, seed))
        benches[0].tolerates_rejects = True
        benches[0].start_firmware()
        benches[0].start()
    rig = rig_of(benches[0])
    with shared(benches, request):
        rig.listen()
        if rig.control is None or rig.control.state != SafetyState.DRIVING:
            rig.arm()
        rig.drive_to_the_middle()
        request.node.stash[BENCHES].append(rig)
        yield rig


@pytest.fixture
def without_floods() -> Iterator[None]:
    """For tests whose robot needs processes that have no priority."""
    with calm():
        yield


@pytest.fixture
def mission_rig(without_floods: None, make_rig: Callable[..., Rig], tmp_path: Path) -> Rig:
    """The firmware in the flat, and all that is needed to drive the patrol."""
    if GUEST_TIME == "real":
        pytest.skip("a guest's processor leaves nothing to navigation in real time")
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


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def connected(make: Callable[..., Rig], **kwargs: str) -> GroundStation:
    """Return a ground station connected to the whole stack of a new bench in standby."""
    port = free_port()
    rig = make(mavlink_url=f"tcpin:127.0.0.1:{port}", **kwargs)
    rig.start_firmware()
    for module in (CONTROL, NAVIGATION, TELEMETRY):
        rig.start(module)
    rig.wait_for_state(SafetyState.STANDBY)
    rig.prefer(NAVIGATION, TELEMETRY)
    station = GroundStation(rig, port)
    station.wait("HEARTBEAT", seconds=PATIENT_S)
    return station


@pytest.fixture
def make_station(
    without_floods: None, make_rig: Callable[..., Rig]
) -> Iterator[Callable[..., GroundStation]]:
    """Makes a ground station connected to the whole stack in standby."""
    with contextlib.ExitStack() as afterwards:

        def make(**kwargs: str) -> GroundStation:
            station = connected(make_rig, **kwargs)
            afterwards.callback(station.link.close)
            return station

        yield make


@pytest.fixture
def station(make_station: Callable[..., GroundStation]) -> GroundStation:
    """A ground station connected to the whole stack in standby."""
    return make_station()


@pytest.fixture
def lasting_station(
    without_floods: None,
    bus: str,
    seed: int,
    benches: list[Bench],
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> Iterator[GroundStation]:
    """A ground station connected to the whole stack in standby, with other tests behind them."""
    if not (benches and isinstance(benches[0], GroundStation)):
        end_all(benches)

        def make(**kwargs: str) -> Rig:
            benches.append(rig := Rig(bus, tmp_path, seed, **kwargs))
            return rig

        benches[0] = connected(make)
    station = benches[0]
    assert isinstance(station, GroundStation)
    with shared(benches, request):
        station.begin_anew()
        request.node.stash[BENCHES].append(station.rig)
        yield station
