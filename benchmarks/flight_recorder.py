"""What recording costs: each tick in the flight recorder, a dump, and the log of states."""

from __future__ import annotations

import functools
import io
import tempfile
import time
from pathlib import Path

import msgspec
from mcap.reader import make_reader
from mcap.writer import Writer

from benchmarks import machine
from robotctl.app.processes.robot import record_header
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.core.checkpoint import checkpoint
from robotctl.logs.logs import FLUSH_NS, scene_of
from robotctl.logs.mcap.entries import Published
from robotctl.logs.mcap.log import McapLog
from robotctl.runtime.flight.ring import FlightRing, dump
from robotctl.workbench.replay.replay import replay_file

RATES_HZ = (200, 1000)
TARGET_SHARE = 0.01
EVERYTHING = {
    "localisation": ('localisation.method="mcl"', "localisation.mapping=true"),
    "overrides": ("camera.enabled=true",),
}
_MEMORY = Path("/dev/shm")


def run(rounds: int, seconds: float) -> None:
    """Measure `FlightRing.record` on the inputs and outputs of a patrol."""
    means_us, p99s_us, longest_us, dumps_ms = [], [], [], []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory(dir=_MEMORY) as folder:
            times_ns, dump_ms = _one_round(Path(folder), seconds)
        times_ns.sort()
        means_us.append(sum(times_ns) / len(times_ns) / 1e3)
        p99s_us.append(times_ns[len(times_ns) * 99 // 100] / 1e3)
        longest_us.append(times_ns[-1] / 1e3)
        dumps_ms.append(dump_ms)
    mean_us = machine.median(means_us)
    rows = [
        (
            f"{rate_hz} Hz",
            f"{mean_us:.2f}",
            f"{machine.median(p99s_us):.1f}",
            f"{machine.median(longest_us):.0f}",
            f"{mean_us * rate_hz / 1e4:.3f} %",
            f"{mean_us * rate_hz / 1e6 / TARGET_SHARE:.2f}",
        )
        for rate_hz in RATES_HZ
    ]
    heads = ("loop", "mean us", "p99 us", "max us (checkpoint)", "CPU", "of the 1 % allowed")
    machine.table("Flight recorder: one tick", heads, rows)
    machine.note(f"a dump takes {machine.median(dumps_ms):.1f} ms, in another process")
    _log_of_states(rounds, seconds)


def _one_round(folder: Path, seconds: float) -> tuple[list[int], float]:
    """Return the time of each tick [ns] and of the dump [ms]; the dump must replay."""
    mission = find_file("patrol", "missions")
    lockstep = LockstepRun(SimOptions(find_file("diff_drive"), mission, max_seconds=seconds))
    stack = lockstep.stack
    header = record_header(lockstep.config, StackOptions("x", "", x_m=1.0, y_m=1.0))
    ring = FlightRing(folder / "x.ring", header, functools.partial(checkpoint, stack.core))
    times_ns: list[int] = []
    tick = stack.tick

    def timed(requests: tuple = ()):  # type: ignore[type-arg,no-untyped-def]
        outputs = tick(requests)
        begin_ns = time.perf_counter_ns()
        ring.record(stack.clock.now_ns(), stack.inputs, outputs, 1000, 200_000)
        times_ns.append(time.perf_counter_ns() - begin_ns)
        return outputs

    stack.tick = timed  # type: ignore[method-assign]
    for _ in lockstep.steps():
        pass
    begin_ns = time.perf_counter_ns()
    dump(folder / "x.ring", folder / "x.rec")
    dump_ms = (time.perf_counter_ns() - begin_ns) / 1e6
    result = replay_file(folder / "x.rec").result
    if result.difference is not None:
        raise AssertionError(f"the dump does not replay: {result.difference}")
    ring.close()
    return times_ns, dump_ms


def _log_of_states(rounds: int, seconds: float) -> None:
    """Measure the log of states, in turn with an MCAP writer that is given ready-made JSON."""
    rows = []
    for name, options in (("odometry alone", {}), ("everything on", EVERYTHING)):
        messages = _published(seconds, **options)
        logged_ms, written_ms, sizes = [], [], []
        for _ in range(rounds):
            content = io.BytesIO()
            logged_ms.append(_logged_ms(messages, content) / seconds)
            sizes.append(len(content.getvalue()) / seconds / 1e3)
            written_ms.append(_written_ms(content) / seconds)
        mean_ms, bare_ms = machine.median(logged_ms), machine.median(written_ms)
        share = f"{mean_ms / 10.0:.3f} %"
        rows.append((name, share, f"{bare_ms / 10.0:.3f} %", f"{machine.median(sizes):.1f}"))
    heads = ("run", "CPU", "of that the bare MCAP writer", "kB/s")
    machine.table("Log of states: control at 50 Hz, navigation at 20 Hz", heads, rows)


def _published(seconds: float, **options: object) -> list[Published]:
    """Return what the processes publish in a patrol; in lockstep control speaks at 20 Hz only."""
    robot, mission = find_file("diff_drive"), find_file("patrol", "missions")
    run = LockstepRun(SimOptions(robot, mission, max_seconds=seconds, **options))
    see, messages = run._see, []
    run._see = lambda control: messages.extend(seen := see(control)) or seen
    for control, navigation in run.steps():
        messages.append(navigation)
        times_ns = (0, 20_000_000, 40_000_000)[: 2 + len(messages) % 2]
        messages += [
            msgspec.structs.replace(control, stamp_ns=control.stamp_ns + later_ns)
            for later_ns in times_ns
        ]
    return messages


def _logged_ms(messages: list[Published], file: io.BytesIO) -> float:
    """Return the processor time that a log of messages takes [ms]."""
    config = load_robot(find_file("diff_drive"), ("camera.enabled=true",))
    begin_ns, flushed_ns = time.process_time_ns(), 0
    log = McapLog(file, 0, "rover", scene_of(config))
    for message in messages:
        log.add(message)
        if message.stamp_ns - flushed_ns >= FLUSH_NS:
            flushed_ns = message.stamp_ns
            log.flush()
    log.close()
    return (time.process_time_ns() - begin_ns) / 1e6


def _written_ms(log: io.BytesIO) -> float:
    """Return the processor time that the messages of a log take without making them [ms]."""
    log.seek(0)
    entries = [
        (channel.topic, message.log_time, message.data)
        for _, channel, message in make_reader(log).iter_messages(log_time_order=False)
    ]
    begin_ns, flushed_ns = time.process_time_ns(), 0
    writer = Writer(io.BytesIO())
    writer.start()
    channels = {topic: writer.register_channel(topic, "json", 0) for topic, *_ in entries}
    for topic, time_ns, data in entries:
        writer.add_message(channels[topic], time_ns, data, time_ns)
        if time_ns - flushed_ns >= FLUSH_NS:
            flushed_ns = time_ns
            writer.flush()
    writer.finish()
    return (time.process_time_ns() - begin_ns) / 1e6
