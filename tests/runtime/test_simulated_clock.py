"""The clock of a simulated run, both ends: it stands still while the computer is held up."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.pace import GONE_NS, MARGIN_NS, PACERS, ClockReader, SharedClock
from robotctl.app.simulation.held_up import HeldUp
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.errors import LinkError
from robotctl.messages.control import ControlState, LoopStatistics
from robotctl.runtime.clock import RealClock
from robotctl.runtime.simulated_clock import Pacer, SimulatedClock
from tests.messages.test_world_pose import STATE

MS = 1_000_000
BEGIN_NS = 1_000_000 * MS


class Computer:
    """CLOCK_MONOTONIC as the test moves it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ns = BEGIN_NS
        monkeypatch.setattr(time, "monotonic_ns", lambda: self.ns)


class Simulator:
    """One that comes to the present of its clock whenever it gets to run."""

    def __init__(self, path: Path) -> None:
        self.clock = SharedClock(path)
        self.now_ns = self.clock.now_ns()

    def run(self) -> None:
        self.now_ns = max(self.now_ns, self.clock.now_ns())
        self.clock.reached(self.now_ns)


@pytest.fixture
def computer(monkeypatch: pytest.MonkeyPatch) -> Computer:
    return Computer(monkeypatch)


@pytest.fixture
def simulator(computer: Computer, tmp_path: Path) -> Simulator:
    assert computer.ns
    return Simulator(tmp_path / "clock")


@pytest.fixture
def robot(simulator: Simulator, tmp_path: Path) -> SimulatedClock:
    assert simulator
    return SimulatedClock(tmp_path / "clock")


def test_time_is_the_computers_while_the_simulator_keeps_up(
    computer: Computer, simulator: Simulator, robot: SimulatedClock
) -> None:
    for _ in range(1000):
        computer.ns += MS
        simulator.run()
        assert robot.now_ns() == simulator.now_ns == computer.ns
    assert robot.longest_ns == 0


def test_time_stands_still_while_the_simulator_is_held_up(
    computer: Computer, simulator: Simulator, robot: SimulatedClock
) -> None:
    held_ns = 61 * MS
    computer.ns += held_ns
    assert robot.now_ns() == BEGIN_NS + MARGIN_NS
    simulator.run()
    assert simulator.now_ns == robot.now_ns() == BEGIN_NS + MARGIN_NS
    computer.ns += MS
    assert robot.now_ns() == BEGIN_NS + MARGIN_NS + MS
    assert robot.longest_ns == held_ns - MARGIN_NS
    robot.forget_longest()
    assert robot.longest_ns == 0


def test_time_goes_on_without_a_simulator_that_hangs_and_without_a_jump(
    computer: Computer, simulator: Simulator, robot: SimulatedClock, tmp_path: Path
) -> None:
    reader = ClockReader(tmp_path / "clock")
    held_ns = BEGIN_NS + MARGIN_NS
    computer.ns += GONE_NS
    assert robot.now_ns() == reader.now_ns() == held_ns
    computer.ns += MS
    assert robot.now_ns() == reader.now_ns() == held_ns + MS
    simulator.run()
    assert simulator.now_ns == robot.now_ns() == reader.now_ns() == held_ns + MS
    computer.ns += MS
    assert robot.now_ns() == reader.now_ns() == simulator.clock.now_ns() == held_ns + 2 * MS


def paced_by(robot: SimulatedClock, pid: int, deadline_ns: int, by: Pacer = Pacer.CONTROL) -> None:
    """Let another process be the one whose sleep the clock waits for."""
    robot._words[by], robot._words[by + 1] = pid, deadline_ns


@pytest.mark.parametrize(("pacer", "number"), [(Pacer.CONTROL, 0), (Pacer.NAVIGATION, 1)])
def test_time_waits_for_a_process_that_is_held_up_but_not_for_one_that_hangs(
    computer: Computer, simulator: Simulator, robot: SimulatedClock, pacer: Pacer, number: int
) -> None:
    deadline_ns = BEGIN_NS + 5 * MS
    paced_by(robot, os.getpid(), deadline_ns, pacer)
    for _ in range(100):
        computer.ns += MS
        simulator.run()
    assert simulator.now_ns == robot.now_ns() == deadline_ns + MARGIN_NS
    assert robot.longest_ns == 100 * MS - 5 * MS - MARGIN_NS
    paced_by(robot, os.getpid(), deadline_ns + 5 * MS, pacer)
    computer.ns += MS
    simulator.run()
    computer.ns += MS
    simulator.run()
    assert simulator.now_ns == deadline_ns + MARGIN_NS + MS
    place, longest_ns = PACERS[number]
    assert place == pacer
    for _ in range(longest_ns // MS + 50):
        computer.ns += MS
        simulator.run()
    assert simulator.now_ns > deadline_ns + 5 * MS + MARGIN_NS + 20 * MS


def test_time_waits_for_the_later_of_control_and_navigation(
    computer: Computer, simulator: Simulator, robot: SimulatedClock
) -> None:
    control_ns, navigation_ns = BEGIN_NS + 40 * MS, BEGIN_NS + 20 * MS
    paced_by(robot, os.getpid(), control_ns)
    paced_by(robot, os.getpid(), navigation_ns, Pacer.NAVIGATION)
    for _ in range(60):
        computer.ns += MS
        simulator.run()
    assert simulator.now_ns == navigation_ns + MARGIN_NS
    paced_by(robot, os.getpid(), control_ns + 50 * MS, Pacer.NAVIGATION)
    for _ in range(60):
        computer.ns += MS
        simulator.run()
    assert simulator.now_ns == control_ns + MARGIN_NS


@pytest.mark.parametrize("how", ["stopped", "killed", "gone"])
def test_time_does_not_wait_for_a_control_process_that_somebody_stopped(
    how: str, computer: Computer, simulator: Simulator, robot: SimulatedClock
) -> None:
    with subprocess.Popen(["/bin/sleep", "60"]) as process:
        number = signal.SIGSTOP if how == "stopped" else signal.SIGKILL
        process.send_signal(number)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
        if how == "gone":
            process.wait()
        paced_by(robot, process.pid, BEGIN_NS + 5 * MS)
        for _ in range(30):
            computer.ns += MS
            simulator.run()
        assert simulator.now_ns > BEGIN_NS + 5 * MS + MARGIN_NS + 15 * MS
        process.kill()


pauses = st.lists(
    st.tuples(
        st.integers(1, 1000 * MS), st.booleans(), st.booleans(), st.integers(0, 20 * MS)
    ),
    max_size=60,
)  # fmt: skip


@given(pauses)
def test_time_never_goes_back_and_no_faster_than_the_computers(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[int, bool, bool, int]]
) -> None:
    path = tmp_path_factory.mktemp("clock") / "clock"
    with pytest.MonkeyPatch.context() as patch:
        computer = Computer(patch)
        simulator, robot = Simulator(path), SimulatedClock(path)
        pid, before_ns, written_ns = os.getpid(), BEGIN_NS, BEGIN_NS
        for passed_ns, runs, paces, ahead_ns in steps:
            computer.ns += passed_ns
            now_ns = robot.now_ns()
            assert 0 <= now_ns - before_ns <= passed_ns
            if computer.ns - written_ns < GONE_NS:
                assert now_ns <= simulator.now_ns + MARGIN_NS
            before_ns = now_ns
            if paces:
                paced_by(robot, pid, now_ns + ahead_ns)
            if runs:
                simulator.run()
                written_ns = computer.ns
                assert simulator.now_ns == robot.now_ns() == now_ns


def test_a_sleep_lasts_until_simulated_time_has_come(tmp_path: Path) -> None:
    owner = SharedClock(tmp_path / "clock")
    clock = SimulatedClock(tmp_path / "clock", Pacer.CONTROL, 3 * MS)
    begin_ns = clock.now_ns()
    deadline_ns = begin_ns + 20 * MS
    pid = os.fork()
    if pid == 0:
        for _ in range(100):
            time.sleep(0.01)  # 5 ms of simulated time at most for 10 ms of the computer's
            owner.reached(owner.now_ns())
        os._exit(0)
    clock.sleep_until(deadline_ns)
    real_ns, simulated_ns = time.monotonic_ns() - begin_ns, clock.now_ns() - begin_ns
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    assert simulated_ns >= 20 * MS
    assert real_ns >= simulated_ns + 10 * MS
    assert tuple(clock._words[6:8]) == (os.getpid(), deadline_ns + 3 * MS)


def test_a_sleep_ends_where_the_simulator_is_gone(tmp_path: Path) -> None:
    SharedClock(tmp_path / "clock").close()
    clock = SimulatedClock(tmp_path / "clock")
    begin_ns = clock.now_ns()
    clock.sleep_until(begin_ns + 10 * MS)
    assert clock.now_ns() - begin_ns >= 10 * MS


def test_a_robot_goes_by_the_simulators_clock_only_where_it_has_one(tmp_path: Path) -> None:
    assert isinstance(StackOptions("name", "robot.toml").open_clock(), RealClock)
    path = tmp_path / "clock"
    with pytest.raises(LinkError, match="clock: no clock of a simulator"):
        StackOptions("name", "robot.toml", clock=str(path)).open_clock()
    SharedClock(path).close()
    assert isinstance(
        StackOptions("name", "robot.toml", clock=str(path)).open_clock(), SimulatedClock
    )


def test_the_simulator_writes_its_clock_and_time_waits_for_it(tmp_path: Path) -> None:
    path = tmp_path / "clock"
    command = (
        *(sys.executable, "-m", "firmware_sim", "--robot", str(find_file("diff_drive"))),
        *("--world", str(find_file("flat", "worlds")), "--bus", f"simcan:{tmp_path / 'bus'}"),
        *("--clock", str(path)),
    )
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        try:
            assert b"ready" in process.stdout.readline()
            clock = SimulatedClock(path)
            process.send_signal(signal.SIGSTOP)
            os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
            begin_ns, real_ns = clock.now_ns(), time.monotonic_ns()
            time.sleep(0.2)
            passed_ns, took_ns = clock.now_ns() - begin_ns, time.monotonic_ns() - real_ns
            process.send_signal(signal.SIGCONT)
            assert passed_ns <= max(0, took_ns - GONE_NS) + MARGIN_NS
            deadline_ns = time.monotonic_ns() + 10_000 * MS
            while clock.now_ns() < begin_ns + 100 * MS:
                assert time.monotonic_ns() < deadline_ns
        finally:
            process.kill()
            process.wait()


def state(lag_ms: float) -> ControlState:
    """Return a state of a control process whose loop was so late."""
    return msgspec.structs.replace(STATE, loop=LoopStatistics(lag_us_max=1e3 * lag_ms))


def test_being_held_up_is_said_once_it_counts_and_again_when_it_doubles() -> None:
    held_up = HeldUp(RealClock())
    assert held_up.step(None, 900 * MS) == ()
    assert held_up.step(state(19.0), 0) == ()
    (said,) = held_up.step(state(19.0), 61 * MS)
    assert said.startswith("this computer was held up for 61 ms")
    assert "--lockstep" in said
    assert held_up.step(state(70.0), 61 * MS) == ()
    assert held_up.longest_ms == 70.0
    assert len(held_up.step(state(140.0), 0)) == 1


def test_being_held_up_before_the_robot_is_there_does_not_count(tmp_path: Path) -> None:
    owner = SharedClock(tmp_path / "clock")
    held_up = HeldUp(SimulatedClock(tmp_path / "clock"))
    owner._words[4] = 300 * MS
    assert held_up.step(state(0.0), 0) == ()
    owner._words[4] = 61 * MS
    (said,) = held_up.step(state(0.0), 0)
    assert said == "this computer was held up for 61 ms; simulated time paused meanwhile"
