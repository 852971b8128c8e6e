"""Running a campaign: as many runs at a time as there are workers, each result kept at once."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Final, TypeAlias

from robotctl.errors import RobotctlError
from robotctl.workbench.campaign.alone import Ending, Program, run_alone, runs_end_with_this
from robotctl.workbench.campaign.campaign_file import AXES
from robotctl.workbench.campaign.plan import CASE, Run, briefly, on_bus
from robotctl.workbench.campaign.results import Result, ResultFolder, result_of

Tell: TypeAlias = Callable[[Result], None]
"""Is told each result."""

_AHEAD: Final = 4
"""Runs handed to each worker ahead of time, so that it never waits for the next."""
_LOOK_S: Final = 5.0
"""Time without a result after which it is looked whether there are workers [s]."""
_PATIENCE_S: Final = 60.0
"""Time that there may be none [s]."""


class WorkersLost(RobotctlError):  # noqa: N818 - what happened
    """No worker is left that could end a run."""


@dataclass(frozen=True, slots=True)
class Workers:
    """Workers of a campaign, of this computer or of others.

    Attributes
    ----------
    executor, count
        Runs so many at a time.
    run
        How each is run: `run_alone`.
    dismiss
        Lets a worker go that cannot run any more; returns False if it is the last one.
    dismissed
        Workers that were let go, with the reason.
    lost
        Returns why there are no workers; empty: there are some.
    """

    executor: Executor
    count: int
    run: Callable[[Program, Sequence[str], float], Ending]
    dismiss: Callable[[str], bool] = lambda _: False
    dismissed: dict[str, str] = field(default_factory=dict)
    lost: Callable[[], str] = lambda: ""

    def ended(self, pending: Collection[Future[Ending]]) -> set[Future[Ending]]:
        """Return those of some runs that are over, once there are any.

        Raises
        ------
        WorkersLost
            If there is no scheduler any more, or for a minute no worker.
        """
        patience_s = _PATIENCE_S
        while True:
            if done := wait(pending, _LOOK_S, FIRST_COMPLETED).done:
                if any(each.cancelled() for each in done):
                    raise WorkersLost("the scheduler is gone, and with it what it ran")
                return done
            asked_s = time.monotonic()
            why = self.lost()
            patience_s = patience_s - _LOOK_S - (time.monotonic() - asked_s) if why else _PATIENCE_S
            if patience_s <= 0.0:
                raise WorkersLost(why)


@contextmanager
def local_workers(count: int, buses: Sequence[str] = ()) -> Iterator[Workers]:
    """Yield workers of this computer: threads that each wait for a run in another process.

    Parameters
    ----------
    count
        How many runs at a time.
    buses
        As many, for runs in real time; empty: they are in lockstep.
    """
    executor = ThreadPoolExecutor(count, thread_name_prefix="run")
    with runs_end_with_this(lambda: executor.shutdown(cancel_futures=True)):
        yield Workers(executor, count, _on_free_bus(buses) if buses else run_alone)


def _on_free_bus(buses: Sequence[str]) -> Callable[[Program, Sequence[str], float], Ending]:
    """Return what runs on a bus that is free, with its share of the processors."""
    processors = sorted(os.sched_getaffinity(0))
    free: SimpleQueue[tuple[str, frozenset[int]]] = SimpleQueue()
    for number, bus in enumerate(buses):
        free.put((bus, frozenset(processors[number :: len(buses)])))

    def run(program: Program, words: Sequence[str], wall_seconds: float) -> Ending:
        bus, own = free.get()
        try:
            return run_alone(program, on_bus(words, bus), wall_seconds, processors=own)
        finally:
            free.put((bus, own))

    return run


def refusals(
    runs: Sequence[Run],
    workers: Workers,
    program: Program,
    wall_seconds: float,
    tell: Callable[[int, int], None],
) -> list[str]:
    """Return why runs cannot begin, each with its command.

    One run of each kind is tried: kinds differ in more than the settings and the seed, and those
    of cases in name or robot. `tell` is told how many were, and of how many.
    """
    kinds: dict[tuple[str, ...], Run] = {}
    for run in runs:
        telling = (CASE, "robot") if CASE in run.factors else AXES
        kinds.setdefault(tuple(str(run.factors[each]) for each in telling), run)
    futures = {
        workers.executor.submit(workers.run, program, briefly(run.words), wall_seconds): run
        for run in kinds.values()
    }
    pending = set(futures)
    while pending:
        tell(len(futures) - len(pending), len(futures))
        pending -= workers.ended(pending)
    return [
        f"{future.result().reason.partition(': ')[2]}\n  {run.command}"
        for future, run in futures.items()
        if future.exception() is None and future.result().is_refused
    ]


def drive(
    batches: Iterable[Sequence[Run]],
    folder: ResultFolder,
    workers: Workers,
    program: Program,
    wall_seconds: float,
    tell: Tell,
) -> None:
    """Drive all runs that have no result yet, and keep each result as it comes.

    Parameters
    ----------
    batches
        All runs of the campaign; the next batch is asked for when all of one are over.
    folder
        Takes the results.
    workers
        What runs them.
    program
        `robotctl`.
    wall_seconds
        Limit of a run in the computer's time [s].
    tell
        Told each result.
    """
    missing: list[Result] = []
    for batch in batches:
        for result in _driven(
            (run for run in batch if not folder.has(run)), workers, program, wall_seconds
        ):
            folder.add(result)
            missing += [] if result.report is not None else [result]
            tell(result)
    folder.finish(missing)


def _driven(
    waiting: Iterator[Run], workers: Workers, program: Program, wall_seconds: float
) -> Iterator[Result]:
    """Yield the result of each run as it comes."""
    pending: dict[Future[Ending], Run] = {}

    def submit(run: Run) -> None:
        words = (program, run.words, wall_seconds)
        pending[workers.executor.submit(workers.run, *words)] = run

    while True:
        for run in waiting:
            submit(run)
            if len(pending) >= _AHEAD * workers.count:
                break
        if not pending:
            return
        for future in workers.ended(pending):
            run = pending.pop(future)
            error = future.exception()
            ending = future.result() if error is None else Ending(reason=f"its worker: {error}")
            if ending.is_disk_full and workers.dismiss(ending.worker):
                workers.dismissed[ending.worker] = ending.reason
                submit(run)
                continue
            yield result_of(run, ending.report, ending.reason)
