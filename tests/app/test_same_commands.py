"""Lockstep and processes: the same inputs give the same commands, since the ticks are the same."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from robotctl.app.processes import navigation
from robotctl.app.processes.control import ControlTicker
from robotctl.app.processes.robot import make_core
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.core.control_core import Inputs, Outputs
from robotctl.core.control_tick import ControlTick
from robotctl.core.navigation_tick import NavigationTick
from robotctl.core.operator import Operator
from robotctl.messages.control import (
    Arm,
    ControlState,
    Feedback,
    Mode,
    NavigationState,
    Notice,
    SetMode,
    VelocityCommand,
)
from robotctl.runtime.clock import VirtualClock
from robotctl.runtime.loop import Loop
from robotctl.workbench.replay.replay import replay_file

encoded = msgspec.msgpack.Encoder().encode
"""Encoded, nan equals nan and 0.0 differs from -0.0."""

SECONDS = 12.0
RUNS = [
    ("diff_drive", {}),
    ("tricycle", {"localisation": ('localisation.method="ekf"',)}),
    ("ackermann", {"faults": find_file("bad_day", "scenarios")}),
    (
        "diff_drive",
        {
            "localisation": (
                'localisation.method="mcl"',
                'localisation.start="unknown"',
                "localisation.mapping=true",
            )
        },
    ),
]


class Lockstep:
    """A run in lockstep, and all that went into its ticks and came out."""

    def __init__(self, robot: str, settings: dict, record: Path) -> None:
        self.record = record
        self.ticks: list[tuple[int, Inputs, Outputs]] = []
        self.steps: list[tuple] = []
        control, receive = ControlTick.control, NavigationTick.receive

        def control_seen(tick, now_ns):
            control(tick, now_ns)
            self.ticks.append((now_ns, tick.inputs, tick.outputs))

        def receive_seen(tick, state, seen):
            receive(tick, state, seen)
            self.steps.append((state, tuple(seen), tick._requests))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ControlTick, "control", control_seen)
            patch.setattr(NavigationTick, "receive", receive_seen)
            options = SimOptions(
                find_file(robot), find_file("patrol", "missions"),
                max_seconds=SECONDS, record=record, **settings,
            )  # fmt: skip
            self.run = LockstepRun(options)
            self.run.run()
        self.options: StackOptions = self.run._stack_options

    @property
    def velocities(self) -> list[VelocityCommand]:
        """What navigation asked of control."""
        asked = (each for _, inputs, _ in self.ticks for each in inputs.requests)
        return [each for each in asked if isinstance(each, VelocityCommand)]


@pytest.fixture(scope="module", params=RUNS, ids=["plain", "ekf", "faults", "mcl"])
def lockstep(request, tmp_path_factory) -> Lockstep:
    robot, settings = request.param
    return Lockstep(robot, settings, tmp_path_factory.mktemp("run"))


class Wire:
    """Brings the frames of a run in lockstep and keeps what is sent."""

    def __init__(self) -> None:
        self.feedback = Feedback()
        self.sent: list[tuple] = []

    def receive(self, _now_ns):
        return self.feedback

    def send(self, command, _now_ns):
        self.sent.append(("command", command))

    def emergency_stop(self, source):
        self.sent.append(("emergency stop", source))

    def clear_faults(self):
        self.sent.append(("clear", None))

    def close(self):
        pass


class Published:
    """A socket on which all that is sent counts."""

    def __init__(self, *_arguments: object, **_options: object) -> None:
        self.messages: list[object] = []
        self.send = self.greet = self.messages.append


class Beats:
    """A heartbeat that nobody minds."""

    def beat(self) -> None:
        pass


def test_the_control_process_gives_the_commands_of_lockstep(lockstep: Lockstep) -> None:
    config = lockstep.run.config
    wire, published, asked = Wire(), Published(), []
    clock = VirtualClock(lockstep.ticks[0][0] - config.runtime.period_ns)
    loop = Loop(clock, config.runtime.period_ns)
    tick = ControlTick(
        wire, make_core(config, lockstep.options), Operator(lambda: asked, published.send)
    )
    ticker = ControlTicker(tick, published, loop, None, Beats())
    notices = []
    for now_ns, inputs, outputs in lockstep.ticks:
        wire.feedback, asked[:], wire.sent = inputs.feedback, inputs.requests, []
        clock.sleep_until(now_ns)
        loop.tick(ticker, now_ns)
        assert encoded(tick.outputs) == encoded(outputs)
        expected = [("command", outputs.command)]
        if outputs.clear_faults:
            expected.insert(0, ("clear", None))
        if outputs.emergency_stop is not None:
            expected.insert(0, ("emergency stop", outputs.emergency_stop))
        assert encoded(wire.sent) == encoded(expected)
        notices += outputs.notices
    assert [each for each in published.messages if isinstance(each, Notice)] == notices
    assert any(outputs.command.enable for _, _, outputs in lockstep.ticks)


class Steps:
    """Clock and sockets of a navigation process that hears what a run in lockstep heard."""

    def __init__(self, lockstep: Lockstep) -> None:
        self._steps = iter(lockstep.steps)
        self._left = len(lockstep.steps)
        self.control, self.seen, self.requests = lockstep.steps[0]
        self.published, self.commands = Published(), Published()

    def now_ns(self) -> int:
        return self.control.stamp_ns

    def sleep_until(self, _deadline_ns: int) -> None:
        self.control, self.seen, self.requests = next(self._steps)
        self._left -= 1

    def over(self) -> bool:
        return self._left == 0

    def install(self, monkeypatch) -> None:
        monkeypatch.setattr(StackOptions, "open_clock", lambda *_, **__: self)
        monkeypatch.setattr(navigation, "StopFlag", lambda: self.over)
        sources = iter([lambda: [self.control], lambda: list(self.seen)])
        monkeypatch.setattr(navigation, "Subscriber", _Typed(lambda: next(sources)))
        monkeypatch.setattr(navigation, "RequestReceiver", _Typed(lambda: self._asked))
        monkeypatch.setattr(navigation, "Publisher", lambda *_: self.published)
        monkeypatch.setattr(navigation, "RequestSender", lambda *_: self.commands)
        monkeypatch.setattr(navigation, "ProcessHeartbeat", lambda _: Beats())

    def _asked(self) -> list:
        return list(self.requests)


class _Typed:
    """Stands for a generic class of sockets."""

    def __init__(self, source) -> None:
        self._source = source

    def __getitem__(self, _kind):
        return self

    def __call__(self, *_arguments):
        return _Socket(self._source())


class _Socket:
    def __init__(self, receive) -> None:
        self.receive = receive


def test_the_navigation_process_gives_the_velocities_of_lockstep(
    lockstep: Lockstep, monkeypatch
) -> None:
    steps = Steps(lockstep)
    steps.install(monkeypatch)
    navigation.run(lockstep.run.config, lockstep.options)
    commands = steps.commands.messages
    velocities = lockstep.velocities  # the last is taken by no tick any more
    assert len(commands) == len(lockstep.steps)
    assert len(velocities) >= len(commands) - 1
    assert encoded(commands[: len(velocities)]) == encoded(velocities)
    assert any(each.v_m_s for each in velocities)
    said = [each for each in steps.published.messages if isinstance(each, NavigationState)]
    assert len(said) == len(commands)


def test_a_record_of_lockstep_replays_to_the_same_commands(lockstep: Lockstep) -> None:
    replayed = replay_file(lockstep.record / "control-0001.rec").result
    assert replayed.difference is None
    assert replayed.agreed == len(lockstep.ticks)


@pytest.mark.parametrize("lockstep", RUNS[:1], ids=["plain"], indirect=True)
def test_auto_is_asked_for_once_and_arming_until_it_is_had(lockstep: Lockstep) -> None:
    modes = [each for _, _, asked in lockstep.steps for each in asked if isinstance(each, SetMode)]
    assert [each.mode for each in modes] == [Mode.AUTO]
    requests = (each for _, inputs, _ in lockstep.ticks for each in inputs.requests)
    arms = [each for each in requests if isinstance(each, Arm)]
    assert len(arms) == 1


def states(run: LockstepRun, *, hold_after_s: float) -> Iterator[tuple[ControlState, Mode]]:
    """Yield the states of a run whose mission is held by somebody else after some time."""
    adapter_ask = run._operator.mode

    def ask(now_ns):
        if now_ns >= hold_after_s * 1e9 and now_ns < hold_after_s * 1e9 + 60_000_000:
            return SetMode(now_ns, Mode.HOLD)
        return adapter_ask(now_ns)

    run._operator.mode = ask  # type: ignore[method-assign]
    for control, navigated in run.steps():
        yield control, navigated.mode


def test_who_is_held_by_somebody_else_stays_so_in_lockstep_too() -> None:
    options = SimOptions(
        find_file("diff_drive"), find_file("patrol", "missions"), max_seconds=SECONDS
    )
    modes = [
        mode
        for control, mode in states(LockstepRun(options), hold_after_s=4.0)
        if control.stamp_ns > 4.2e9
    ]
    assert set(modes) == {Mode.HOLD}


def test_what_navigation_has_to_say_is_told_in_lockstep_too(monkeypatch) -> None:
    """A navigator that is told of no station holds, and says why: lockstep heard nothing of it."""
    options = SimOptions(
        find_file("diff_drive"), find_file("patrol", "missions"), max_seconds=SECONDS
    )
    run = LockstepRun(options)
    heard: list[object] = []
    hear = run._hear
    run._tick._operator = Operator(run._ask, lambda each: (heard.append(each), hear(each)))
    run._tick._adapter._notices.append("something to say")
    for _ in run.steps():
        break
    assert [each.text for each in heard if isinstance(each, Notice)] == ["something to say"]
