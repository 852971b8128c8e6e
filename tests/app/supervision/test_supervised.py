"""One supervised process, with real processes: ready, dead, hung, started again, told of a stop."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robotctl.app.supervision.pause import Pause
from robotctl.app.supervision.restart import RestartPolicy
from robotctl.app.supervision.supervised import Exit, ProcessPhase, Role, Supervised

BEATING = """
import os, sys, time
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
heartbeat = ProcessHeartbeat(os.environ)
while True:
    heartbeat.beat()
    time.sleep(0.01)
"""
STUCK_AFTER_A_BEAT = BEATING.replace("time.sleep(0.01)", "time.sleep(1000)")
SILENT = "import time; time.sleep(1000)"
DEADLINE_S = 20.0
QUICK = RestartPolicy(crashes=2, first_delay_s=0.01, longest_delay_s=0.02)


class Watched:
    """A process and what its supervisor has seen."""

    def __init__(self, program: str, **given: object) -> None:
        values = {"restart": QUICK, "stall_s": 30.0, "start_s": 30.0} | given
        self.process = Supervised(
            Role("robotctl.app.part", **values), [sys.executable, "-c", program]
        )
        self.exits: list[Exit] = []
        self.pauses: list[Pause] = []
        self.process.start(time.monotonic())

    def until(self, condition: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline_s, (what, self.process.phase, self.exits)
            seen = self.process.step(time.monotonic())
            if isinstance(seen, Exit):
                self.exits.append(seen)
            elif seen is not None:
                self.pauses.append(seen)
            time.sleep(0.005)

    def phase(self, phase: ProcessPhase) -> None:
        self.until(lambda: self.process.phase is phase, phase.value)


@pytest.fixture
def watched() -> Iterator[Callable[..., Watched]]:
    made: list[Watched] = []

    def make(program: str, **role: object) -> Watched:
        made.append(Watched(program, **role))
        return made[-1]

    yield make
    for each in made:
        each.process.signal(signal.SIGKILL)
        each.process.end(DEADLINE_S)


def test_a_process_is_ready_when_it_makes_progress_and_not_when_it_merely_lives(watched) -> None:
    silent, beating = watched(SILENT), watched(BEATING)
    beating.phase(ProcessPhase.READY)
    silent.process.step(time.monotonic())
    assert silent.process.phase is ProcessPhase.STARTING
    assert not silent.process.was_ready


def test_a_killed_process_is_started_again_until_its_budget_is_spent(watched) -> None:
    part = watched(BEATING)
    pids = []
    for _ in range(3):
        part.phase(ProcessPhase.READY)
        pids.append(part.process.pid)
        os.kill(part.process.pid, signal.SIGKILL)
        part.until(lambda: len(part.exits) == len(pids), "the end is seen")
    assert part.process.phase is ProcessPhase.GIVEN_UP
    assert [each.pid for each in part.exits] == pids
    assert len(set(pids)) == 3
    assert [each.restart_in_s for each in part.exits] == [0.01, 0.02, None]
    assert all(each.was_ready and each.beats > 0 for each in part.exits)
    assert "signal 9, SIGKILL" in part.exits[0].words()
    assert "too often" in part.exits[-1].words()
    part.process.step(time.monotonic() + 1000.0)
    assert part.process.pid is None


@pytest.mark.parametrize("program", [STUCK_AFTER_A_BEAT, SILENT])
def test_a_process_without_progress_is_killed_and_started_again(watched, program: str) -> None:
    part = watched(program, stall_s=0.1, start_s=1.0)
    part.until(lambda: part.process.starts == 2, "a second start")
    (ended,) = part.exits
    assert ended.hung
    assert ended.status == -signal.SIGKILL
    assert ended.was_ready == (program is STUCK_AFTER_A_BEAT)


def test_a_pause_of_the_supervisor_itself_is_not_held_against_a_process(watched) -> None:
    part = watched(STUCK_AFTER_A_BEAT, stall_s=1.5)
    part.phase(ProcessPhase.READY)
    now_s = time.monotonic()
    for jump_s in (1000.0, 2000.0):
        part.process.step(now_s + jump_s)
        os.kill(part.process.pid, 0)
        assert part.process.step(now_s + jump_s) is None


def test_a_process_that_is_held_up_is_said_once_with_its_cause_and_so_is_its_going_on(
    watched,
) -> None:
    part = watched(BEATING, held_s=0.3)
    part.phase(ProcessPhase.READY)
    pid = part.process.pid
    os.kill(pid, signal.SIGSTOP)
    part.until(lambda: part.pauses, "it is said")
    end_s = time.monotonic() + 0.5
    part.until(lambda: time.monotonic() > end_s, "a while")
    os.kill(pid, signal.SIGCONT)
    part.until(lambda: len(part.pauses) > 1, "it goes on")
    begun, over = part.pauses
    assert (begun.name, begun.pid, begun.over) == ("part", pid, False)
    assert 0.3 < begun.paused_s < 0.8
    assert begun.cause == over.cause == "stopped by a signal"
    assert over.over
    assert over.paused_s > 0.7
    assert not part.exits


def test_a_process_that_was_stopped_for_too_long_hung_for_that_cause(watched) -> None:
    part = watched(BEATING, stall_s=0.3)
    part.phase(ProcessPhase.READY)
    os.kill(part.process.pid, signal.SIGSTOP)
    part.until(lambda: part.exits, "killed")
    words = part.exits[0].words()
    assert "(it hung, signal 9, SIGKILL: stopped by a signal); restarting it" in words


def test_a_process_that_was_killed_while_the_computer_was_out_of_memory_says_so(
    watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = 3
    monkeypatch.setattr("robotctl.app.supervision.supervised.killed_for_memory", lambda: killed)
    part = watched(BEATING)
    part.phase(ProcessPhase.READY)
    killed = 4
    os.kill(part.process.pid, signal.SIGKILL)
    part.until(lambda: part.exits, "ended")
    assert "(signal 9, SIGKILL: the computer was out of memory)" in part.exits[0].words()


def test_a_renewed_process_costs_no_budget(watched) -> None:
    part = watched(BEATING)
    for life in range(1, 6):
        part.until(lambda: part.process.phase is ProcessPhase.READY, "ready")
        part.process.renew()
        part.until(lambda life=life: len(part.exits) == life, "ended")
    part.phase(ProcessPhase.READY)
    assert all(each.asked and each.restart_in_s == 0.0 for each in part.exits)


def test_a_renewed_process_that_hangs_instead_of_ending_is_killed_and_that_is_said(watched) -> None:
    deaf = f"import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); {STUCK_AFTER_A_BEAT}"
    part = watched(deaf, stall_s=0.3)
    part.phase(ProcessPhase.READY)
    part.process.renew()
    part.until(lambda: part.exits, "killed")
    assert "it hung, signal 9, SIGKILL" in part.exits[0].words()


def test_what_the_robot_can_do_without_is_killed_first_when_memory_is_short(watched) -> None:
    vital, other = watched(SILENT, vital=True), watched(SILENT)
    score = [
        int(Path(f"/proc/{each.process.pid}/oom_score_adj").read_text()) for each in (vital, other)
    ]
    assert score[0] < score[1]


@pytest.mark.parametrize("nice", [-10, 5])
def test_the_kernel_prefers_what_the_robot_drives_by_where_it_may(watched, nice: int) -> None:
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    part = watched(SILENT, nice=nice)
    taken = os.getpriority(os.PRIO_PROCESS, part.process.pid)
    assert taken == (nice if os.geteuid() == 0 or nice > usual else usual)


def test_an_emergency_signal_sent_before_the_process_can_take_it_is_neither_lost_nor_deadly(
    watched, tmp_path: Path
) -> None:
    told = tmp_path / "told"
    part = watched(
        "import time; time.sleep(0.3)\n"
        "from pathlib import Path\n"
        "from robotctl.app.supervision.signals import EmergencySignal\n"
        "signal = EmergencySignal()\n"
        f"Path({str(told)!r}).write_text(str((signal.take(), signal.take())))\n"
        "time.sleep(1000)"
    )
    assert part.process.signal(signal.SIGUSR1)
    part.until(lambda: told.exists() and told.read_text() != "", "the process has its handler")
    assert told.read_text() == "(True, False)"
