"""The page in a browser: how soon it is there, and how soon it shows what the server was given.

The peer is a page that draws nothing, and notes when the same messages come: what server, loopback
and browser take by themselves.
"""

from __future__ import annotations

import os
import shutil
from typing import Any, Final

import numpy as np

from benchmarks import machine
from tests.web.page.served_robot import ServedRobot

PARTICLES: Final = 2000
FIRST_PAINT_MS: Final = 1000
DRAWN_MS: Final = 15
"""Goals: first paint, and from the server to what is drawn, 95 %."""

_CHROMIUM = os.environ.get("ROBOTCTL_CHROMIUM") or "chromium"

_BARE = """() => {
  window.seen = [];
  const wanted = new TextEncoder().encode("ControlState");
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => {
    const bytes = new Uint8Array(data);
    const at = performance.timeOrigin + performance.now();
    let place = bytes.indexOf(wanted[0]);
    while (place >= 0 && !wanted.every((byte, i) => bytes[place + i] === byte))
      place = bytes.indexOf(wanted[0], place + 1);
    // Behind the name: "stamp_ns" and an integer of 64 bits.
    if (place >= 0) seen.push([Number(new DataView(data).getBigUint64(place + 12 + 9 + 1)), at]);
  };
}"""
_DRAWN = """() => {
  window.seen = [];
  document.querySelector(".map canvas").addEventListener("drawn", ({ detail }) => {
    seen.push([detail, performance.timeOrigin + performance.now()]);
  });
}"""
_PAINT = """() => performance.getEntriesByName("first-contentful-paint")[0].startTime"""


def run(rounds: int, seconds: float) -> None:
    """Measure a robot with 2000 particles, a scan and a plan, 20 times a second."""
    if shutil.which(_CHROMIUM) is None:
        machine.note(f"\nnot run: no {_CHROMIUM}; the page needs a browser (ROBOTCTL_CHROMIUM)")
        return
    from playwright.sync_api import sync_playwright

    robot = ServedRobot()
    rng = np.random.default_rng(1)
    robot.particles = rng.uniform(1.0, 5.0, (PARTICLES, 3)).astype(np.float32)
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which(_CHROMIUM), args=["--no-sandbox"]
            )
            paints, bare, drawn = [], [], []
            for _ in range(rounds):
                page = browser.new_context().new_page()
                page.goto(robot.url)
                page.locator(".pill.state-ARMED").wait_for()
                paints.append(page.evaluate(_PAINT))
                drawn += _delays(robot, page, _DRAWN, seconds)
                page.goto(f"{robot.url}assets/page.css")
                bare += _delays(robot, page, _BARE, seconds)
                page.context.close()
            browser.close()
    finally:
        robot.stop()
    rows = [
        ("first paint with content", *_figures(paints), str(FIRST_PAINT_MS)),
        ("peer: server to a page that draws nothing", *_figures(bare), "-"),
        ("server to drawn", *_figures(drawn), str(DRAWN_MS)),
    ]
    heads = ("what", "median ms", "95 % ms", "99 % ms", "goal ms")
    machine.table(f"The page over loopback, {PARTICLES} particles at 20 Hz", heads, rows)


def _delays(robot: ServedRobot, page: Any, script: str, seconds: float) -> list[float]:
    """Return how long after the server was given a state the page had it [ms]."""
    page.evaluate(script)
    page.wait_for_timeout(1e3 * seconds)
    first: dict[float, float] = {}
    for stamp_ns, at_ms in page.evaluate("() => seen"):
        first.setdefault(stamp_ns, at_ms)
    first.pop(min(first))  # it may have been drawn before
    # JavaScript rounds the stamps.
    given_ms = {float(stamp): at / 1e6 for stamp, at in robot.published_ns.items()}
    return [at_ms - given_ms[stamp] for stamp, at_ms in first.items()]


def _figures(values: list[float]) -> tuple[str, str, str]:
    """Return median, 95 % and 99 %."""
    median, high, highest = np.percentile(values, (50, 95, 99))
    return f"{median:.1f}", f"{high:.1f}", f"{highest:.1f}"
