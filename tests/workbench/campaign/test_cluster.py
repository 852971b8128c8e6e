"""A scheduler of Dask with its workers, as a user starts them."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest

from robotctl.errors import ConfigError
from robotctl.workbench.campaign import cluster, engine
from robotctl.workbench.campaign.alone import Program
from robotctl.workbench.campaign.cluster import Identity, cluster_workers, digests, unfit
from robotctl.workbench.campaign.engine import WorkersLost, drive
from robotctl.workbench.campaign.plan import Run
from robotctl.workbench.campaign.results import RUNS, ResultFolder, result_of
from tests.workbench.campaign.reports import head

ROOT = Path(__file__).parents[3]
OTHER = "import robotctl.workbench.campaign.cluster as c\nc.own_sources = lambda: 'other'\n"


def main() -> None:
    """Be a run that takes a second, or as many as the second argument says."""
    time.sleep(float(sys.argv[2]) if len(sys.argv) > 4 else 1.0)
    Path(sys.argv[-1]).write_bytes(report_of(int(sys.argv[1])))
    sys.exit(0)


def report_of(seed: int) -> bytes:
    """Return a report for which a disk needs some room."""
    return json.dumps({"seed": seed, "faults": [], "message": 32_000 * "x"}).encode()


@contextmanager
def dask(*words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Start a part of Dask, and end it with all its children."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=environment,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@contextmanager
def scheduler(folder: Path) -> Iterator[str]:
    """Start a scheduler; yield its address."""
    with scheduler_process(folder) as (address, _):
        yield address


@contextmanager
def scheduler_process(folder: Path) -> Iterator[tuple[str, "subprocess.Popen[bytes]"]]:
    """Start a scheduler; yield its address and process."""
    file = folder / "scheduler.json"
    words = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    with dask("scheduler", *words) as process:
        deadline_s = time.monotonic() + 200.0
        while not file.exists() or "tcp://" not in file.read_text():
            assert time.monotonic() < deadline_s
            time.sleep(0.1)
        yield json.loads(file.read_text())["address"], process


def worker(address: str, folder: Path, *words: str):
    """Return a worker that is to be started."""
    return dask("worker", address, "--nthreads", "1", "--no-dashboard", "--local-directory",
                str(folder), *words)  # fmt: skip


@contextmanager
def fit_workers(address: str, count: int):
    """Yield the workers of a scheduler once so many have come."""
    deadline_s = time.monotonic() + 200.0
    while True:
        with ExitStack() as stack:
            try:
                workers = stack.enter_context(cluster_workers(address, ()))
            except ConfigError:
                workers = None
            if workers is not None and workers.count == count:
                yield workers
                return
        assert time.monotonic() < deadline_s
        time.sleep(0.5)


@contextmanager
def full_worker(address: str, folder: Path) -> Iterator[None]:
    """Start a worker whose disk has no room for a report: in a mount namespace of its own."""
    if subprocess.run(["unshare", "-m", "true"], check=False, capture_output=True).returncode:
        pytest.skip("mount namespace missing: no right to unshare -m")
    disk = folder / "disk"
    disk.mkdir()
    fill = f"mount -t tmpfs -o size=64k none {disk} && head -c 48k /dev/zero > {disk}/all"
    words = ("worker", address, "--nthreads", "1", "--no-dashboard", "--local-directory", folder)
    command = f"{fill} && exec {sys.executable} -m dask {' '.join(map(str, words))}"
    process = subprocess.Popen(
        ["unshare", "-m", "sh", "-c", command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(disk)},
        start_new_session=True,
    )
    try:
        yield
    finally:
        with suppress(ProcessLookupError):  # it has been let go
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.mark.timeout(600)
def test_a_worker_that_is_killed_and_one_with_a_full_disk_cost_nothing(tmp_path):
    runs = [Run(number, {"seed": number}, (str(number),)) for number in range(1, 17)]
    told = []
    with ResultFolder(tmp_path / "here", head(16)) as folder:
        for run in runs:
            folder.add(result_of(run, report_of(run.number), ""))
    with (
        scheduler(tmp_path) as address,
        worker(address, tmp_path),
        worker(address, tmp_path),
        worker(address, tmp_path) as killed,
        full_worker(address, tmp_path),
        fit_workers(address, 4) as workers,
        ResultFolder(tmp_path / "there", head(16)) as folder,
    ):
        threading.Timer(2.5, os.killpg, (killed.pid, signal.SIGKILL)).start()
        drive([runs], folder, workers, Program(main), 60.0, told.append)
    assert sorted(each.number for each in told) == [*range(1, 17)]
    here_lines, there_lines = ((tmp_path / each / RUNS).read_bytes() for each in ("here", "there"))
    assert there_lines == here_lines
    assert [*workers.dismissed.values()] == [f"{tmp_path}/disk is full"]


@pytest.mark.timeout(600)
def test_ctrl_c_ends_the_runs_on_a_cluster(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with scheduler(tmp_path) as address, worker(address, tmp_path):
        with suppress(KeyboardInterrupt), fit_workers(address, 1) as workers:
            workers.executor.submit(workers.run, Program(main), ("1", "60"), 60.0)
            wait_until(lambda: [*tmp_path.glob("robotctl-run-*/output")])
            raise KeyboardInterrupt
        wait_until(lambda: not [*tmp_path.glob("robotctl-run-*")], 20.0)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("lost", ["worker", "scheduler"])
def test_a_campaign_whose_workers_are_gone_ends_and_keeps_what_it_has(tmp_path, monkeypatch, lost):
    monkeypatch.setattr(engine, "_LOOK_S", 1.0)
    monkeypatch.setattr(engine, "_PATIENCE_S", 3.0)
    first, endless = Run(1, {"seed": 1}, ("1",)), Run(2, {"seed": 2}, ("2", "999"))
    with ExitStack() as stack, ResultFolder(tmp_path / "there", head(2)) as folder:
        address, head_process = stack.enter_context(scheduler_process(tmp_path))
        hand_process = stack.enter_context(worker(address, tmp_path, "--no-nanny"))
        workers = stack.enter_context(fit_workers(address, 1))

        def tell(_result: object) -> None:
            (hand_process if lost == "worker" else head_process).kill()

        with pytest.raises(WorkersLost, match=lost):
            drive([[first, endless]], folder, workers, Program(main), 60.0, tell)
        assert [*folder.done] == [1]


def wait_until(condition, limit_s: float = 200.0) -> None:
    deadline_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


@pytest.mark.timeout(600)
def test_a_worker_with_another_robotctl_or_other_files_is_refused_and_named(tmp_path, monkeypatch):
    preload = tmp_path / "other.py"
    preload.write_text(OTHER)
    file = tmp_path / "robot.toml"
    file.write_text("")
    with scheduler(tmp_path) as address:
        with pytest.raises(ConfigError, match=f"has no workers; `dask worker {address}` starts"):
            cluster_workers(address, ()).__enter__()
        with monkeypatch.context() as patch:
            patch.setattr(cluster, "version", lambda _: "1999.1")
            with pytest.raises(ConfigError, match=r"has distributed 20.*, this computer 1999\.1"):
                cluster_workers(address, ()).__enter__()
        with worker(address, tmp_path, "--preload", str(preload)):
            deadline_s = time.monotonic() + 200.0
            said = "has no workers"
            while "has no workers" in said:
                assert time.monotonic() < deadline_s
                with pytest.raises(ConfigError) as refused:
                    cluster_workers(address, (file,)).__enter__()
                said = str(refused.value)
    assert "has robotctl 0.1.0, sources other, this computer 0.1.0, sources" in said
    assert len(said.splitlines()) == 1


def test_a_scheduler_that_is_not_there_or_is_something_else_is_said():
    with pytest.raises(ConfigError, match="no scheduler of Dask answers there"):
        cluster_workers("tcp://127.0.0.1:9", ()).__enter__()
    with pytest.raises(ConfigError, match="no scheduler of Dask answers there"):
        cluster_workers("nonsense://x", ()).__enter__()


def test_all_that_makes_workers_unfit_is_named(tmp_path, monkeypatch):
    ours = Identity("0.1.0, sources a", ("Python 3.11.7", "numpy 2.4.0", "x86_64"))
    theirs = {
        "tcp://a:1": ours,
        "tcp://b:1": Identity("0.1.0, sources a", ("Python 3.12.1", "numpy 2.4.0", "aarch64")),
        "tcp://c:1": ModuleNotFoundError("No module named 'robotctl'"),
        "tcp://d:1": Identity("0.1.0, sources a", ours.others, ("/home/me/robot.toml",)),
    }
    assert [*unfit(ours, theirs)] == [
        "worker tcp://b:1: has Python 3.12.1, this computer Python 3.11.7",
        "worker tcp://b:1: has aarch64, this computer x86_64",
        "worker tcp://c:1: has no robotctl like this one: No module named 'robotctl'",
        "worker tcp://d:1: /home/me/robot.toml: is missing there, or is another file",
    ]
    assert digests([tmp_path / "none"]) == {str(tmp_path / "none"): ""}
