"""Runs in real time: each has a bus and processors to itself."""

import os
import sys
import time
from pathlib import Path

import pytest

from robotctl.workbench.campaign.alone import Program
from robotctl.workbench.campaign.engine import local_workers


def main() -> None:
    """Report the bus and the processors, once as many runs as buses are there."""
    folder, bus = Path(sys.argv[1]), sys.argv[3]
    (folder / bus).touch()
    deadline_s = time.monotonic() + 60.0
    while len([*folder.iterdir()]) < int(sys.argv[4]):
        assert time.monotonic() < deadline_s, "the others do not run meanwhile"
        time.sleep(0.01)
    Path(sys.argv[-1]).write_text(f"{bus} {sorted(os.sched_getaffinity(0))}")
    sys.exit(0)


@pytest.mark.parametrize("count", [1, 2])
def test_runs_at_a_time_share_neither_bus_nor_processor(tmp_path, count):
    processors = sorted(os.sched_getaffinity(0))
    if len(processors) < count:
        pytest.skip(f"{count} processors missing")
    buses = [f"vcan{number}" for number in range(count)]
    words = (str(tmp_path), "--bus", "vcan0", str(count))
    with local_workers(count, buses) as workers:
        futures = [
            workers.executor.submit(workers.run, Program(main), words, 60.0) for _ in range(6)
        ]
        found = {future.result().report.decode() for future in futures}
    assert found == {f"vcan{n} {processors[n::count]}" for n in range(count)}
