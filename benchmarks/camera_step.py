"""What a picture costs the ground-plane camera: ranges and obstacles, lookup included."""

from __future__ import annotations

import time

import cv2
import numpy as np

from benchmarks import machine
from benchmarks.camera_scenes import Shot, cluttered_shots, geometry, office_shots
from robotctl.estimation.camera import colour as camera_colour
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.ground import GroundCamera


def run(rounds: int, _seconds: float) -> None:
    """Measure all, in processor time, OpenCV with one thread."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(4)
    rows = [
        _row("office", list(office_shots(rng, 4, 10)), rounds),
        _row("clutter", list(cluttered_shots(rng, 4, 10)), rounds),
    ]
    cv2.setNumThreads(threads)
    lens = geometry().intrinsics
    machine.table(
        f"Camera step, {lens.width_px} x {lens.height_px}: ranges and obstacles, CPU ms",
        ("pictures", "median of rounds", "90 %", "lookup", "colours"),
        rows,
    )


def _row(name: str, shots: list[Shot], rounds: int) -> tuple[str, ...]:
    """Return the line of one kind of picture."""
    camera = GroundCamera(geometry(), GroundCameraConfig())
    strip = camera.strip
    for shot in shots[:3]:
        camera.step(shot.picture, 0)
    whole: list[float] = []
    look: list[float] = []
    colours: list[float] = []
    medians = []
    for _ in range(rounds):
        for shot in shots:
            began = time.process_time()
            camera.step(shot.picture, 0)
            whole.append(1e3 * (time.process_time() - began))
            began = time.process_time()
            pixels = strip.look(shot.picture)
            between = time.process_time()
            camera_colour.colour_bins(pixels, strip.edges, strip.halves)
            look.append(1e3 * (between - began))
            colours.append(1e3 * (time.process_time() - between))
        medians.append(float(np.median(whole[-len(shots) :])))
    return (
        name,
        f"{np.median(medians):.2f} ({min(medians):.2f} to {max(medians):.2f})",
        f"{np.percentile(whole, 90):.2f}",
        f"{np.median(look):.2f}",
        f"{np.median(colours):.2f}",
    )
