"""An hour in the page: how soon it is there, how long a scrub takes, and the memory of it.

The peer is the reader of the `mcap` package, which is asked for the newest message of each topic at
the same times: what any server that keeps nothing would take for its answer, without a page.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from benchmarks import machine

HOUR_S: Final = 3600
FIRST_S, SCRUB_MS, MEMORY_MIB = 3.0, 100.0, 300.0
"""Goals: first picture, a scrub until it is drawn, and the server's memory."""
_SIMULATED_S: Final = 40
_FILE_BYTES: Final = 64_000_000
_SCRUBS: Final = 40

_CHROMIUM = os.environ.get("ROBOTCTL_CHROMIUM") or "chromium"

_FIRST = """() => new Promise((resolve) => {
  const wait = () => {
    const canvas = document.querySelector(".map canvas");
    if (canvas === null) return setTimeout(wait, 5);
    canvas.addEventListener("drawn", () => {
      const isThere = document.querySelector(".bar .pill:not(.state-none)") !== null;
      if (isThere) resolve(performance.timeOrigin + performance.now());
    });
  };
  wait();
})"""
_SCRUB = """(share) => new Promise((resolve) => {
  const slider = document.querySelector(".replay input[type=range]");
  slider.value = String(Number(slider.max) * share);
  const wanted = slider.valueAsNumber * 1e9;
  const begin = performance.now();
  const canvas = document.querySelector(".map canvas");
  const drawn = ({ detail }) => {
    if (detail > wanted + 1e6 || detail < wanted - 0.3e9) return;
    canvas.removeEventListener("drawn", drawn);
    resolve(performance.now() - begin);
  };
  canvas.addEventListener("drawn", drawn);
  slider.dispatchEvent(new Event("input", { bubbles: true }));
  slider.dispatchEvent(new Event("change", { bubbles: true }));
})"""


def run(rounds: int, _seconds: float) -> None:
    """Measure an hour of a robot with 60 states and 20 scans a second, in files of 64 MB."""
    if shutil.which(_CHROMIUM) is None:
        machine.note(f"\nnot run: no {_CHROMIUM}; the page needs a browser (ROBOTCTL_CHROMIUM)")
        return
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        files = hour_of(_recorded(Path(folder) / "short"), Path(folder) / "hour")
        size_mb = sum(each.stat().st_size for each in files) / 1e6
        shares = np.random.default_rng(1).uniform(0.01, 0.99, _SCRUBS).tolist()
        browser = playwright.chromium.launch(
            executable_path=shutil.which(_CHROMIUM), args=["--no-sandbox"]
        )
        firsts, scrubs, memory = [], [], []
        for _ in range(rounds):
            begin_s = time.time()
            with subprocess.Popen(
                [sys.executable, "-m", "robotctl", "view", str(files[0].parent)],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            ) as server:
                try:
                    page = browser.new_context().new_page()
                    link = re.search(r"http\S+", server.stdout.readline() if server.stdout else "")
                    page.goto(link[0] if link else "")
                    firsts.append(page.evaluate(_FIRST) / 1e3 - begin_s)
                    # Plots and path of the whole run, which the scrubs then move along.
                    page.wait_for_selector(".replay-states rect", state="attached", timeout=120_000)
                    scrubs += [page.evaluate(_SCRUB, share) for share in shares]
                    page.context.close()
                    memory.append(_most_mib(server.pid))
                finally:
                    server.terminate()
        browser.close()
        peer = _peer_ms(files, shares[:5])
    rows = [
        ("start of robotctl view to the first picture", *_figures(firsts, 2, "s"), f"{FIRST_S} s"),
        ("scrub until it is drawn", *_figures(scrubs, 0, "ms"), f"{SCRUB_MS:.0f} ms"),
        ("peer: newest of each topic by the mcap package", *_figures(peer, 0, "ms"), "-"),
        ("most memory of the server", *_figures(memory, 0, "MiB"), f"{MEMORY_MIB:.0f} MiB"),
    ]
    title = f"Replay of an hour, {size_mb:.0f} MB in {len(files)} files"
    machine.table(title, ("what", "median", "95 %", "goal"), rows)


def _recorded(folder: Path) -> Path:
    """Return a log of a simulated robot with people about."""
    command = ["sim", "--lockstep", "--world", "flat", "--localiser", "mcl", "--people", "2"]
    length = ["--max-seconds", str(_SIMULATED_S), "--record", str(folder)]
    subprocess.run(
        [sys.executable, "-m", "robotctl", *command, *length], check=False, capture_output=True
    )
    return folder / "robot-0001.mcap"


def hour_of(source: Path, folder: Path, seconds: int = HOUR_S) -> list[Path]:
    """Write a recording over and over until it lasts an hour; each state three times."""
    folder.mkdir()
    with source.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        messages = [(channel, message) for _, channel, message in reader.iter_messages()]
    assert summary is not None
    first_ns = min(message.log_time for _, message in messages)
    length_ns = max(message.log_time for _, message in messages) - first_ns + 50_000_000
    files: list[Path] = []
    writer, out = None, None
    for shift_ns in range(0, seconds * 10**9, length_ns):
        if out is None or out.tell() > _FILE_BYTES or writer is None:
            if writer is not None and out is not None:
                writer.finish()
                out.close()
            files.append(folder / f"robot-{len(files) + 1:04d}.mcap")
            out = files[-1].open("wb")
            writer = Writer(out)
            writer.start(library="robotctl benchmark")
            schemas = {
                number: writer.register_schema(each.name, each.encoding, each.data)
                for number, each in summary.schemas.items()
            }
            channels = {
                number: writer.register_channel(
                    each.topic, each.message_encoding, schemas[each.schema_id]
                )
                for number, each in summary.channels.items()
            }
        flushed_ns = 0
        for channel, message in messages:
            at_ns = message.log_time + shift_ns
            for later_ns in (0, 16_000_000, 33_000_000) if channel.topic == "control" else (0,):
                time_ns = at_ns + later_ns
                writer.add_message(channels[channel.id], time_ns, message.data, time_ns)
            if at_ns - flushed_ns >= 10**9:  # as the recorder does
                flushed_ns = at_ns
                writer.flush()
    if writer is not None and out is not None:
        writer.finish()
        out.close()
    return files


def _peer_ms(files: list[Path], shares: list[float]) -> list[float]:
    """Return how long the mcap package takes for the newest message of each topic [ms]."""
    took = []
    for share in shares:
        begin_s = time.perf_counter()
        with files[int(share * len(files))].open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            first, last = summary.statistics.message_start_time, summary.statistics.message_end_time
            at_ns = round(first + share * (last - first))
            for channel in summary.channels.values():
                newest = reader.iter_messages([channel.topic], ending_at=at_ns, reverse=True)
                next(iter(newest), None)
        took.append(1e3 * (time.perf_counter() - begin_s))
    return took


def _most_mib(pid: int) -> float:
    """Return the most memory that a process has had [MiB]."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    return int(found[1]) / 1024 if found else float("nan")


def _figures(values: list[Any], digits: int, unit: str) -> tuple[str, str]:
    """Return median and 95 %."""
    median, high = np.percentile(values, (50, 95))
    return f"{median:.{digits}f} {unit}", f"{high:.{digits}f} {unit}"
