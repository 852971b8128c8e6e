"""Walls and corners in the scans of public lidar logs: how many, how well they lie, what they cost.

ROBOTCTL_DATA names the folder of the recordings.
"""

from __future__ import annotations

import math
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import machine
from benchmarks.localisation_accuracy import LOGS
from robotctl.estimation.landmarks.scan_lines import ScanLines, find_lines
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.model.recording import RecordedScan

EVERY = 5
LONG_M = 1.5


def run(_rounds: int, _seconds: float) -> None:
    """Measure all."""
    folder = Path(os.environ.get("ROBOTCTL_DATA", machine.ROOT.parent / "shared" / "data"))
    if not (folder / "carmen").is_dir():
        machine.note(f"lines: not measured, no {folder / 'carmen'}; set ROBOTCTL_DATA")
        return
    heads = (
        "log",
        "beams",
        "CPU ms a scan",
        "walls a scan",
        "corners",
        "beams on walls",
        "rms off, mm",
        "chi2 / dof",
        "right angles",
    )
    rows = [_row(name, folder / "carmen" / file) for name, (file, _) in LOGS.items()]
    machine.table("Lines in every fifth scan", heads, rows)


def _row(name: str, path: Path) -> tuple[str, ...]:
    scans = read_recording(path).scans[::EVERY]
    find_lines(scans[0].scan)
    began = time.process_time()
    found = [find_lines(entry.scan) for entry in scans]
    spent_ms = 1e3 * (time.process_time() - began) / len(scans)
    segments = [each for lines in found for each in lines.segments]
    hits = sum(len(entry.scan.points_base()) for entry in scans)
    off = np.concatenate([_off(*pair) for pair in zip(scans, found, strict=True)])
    chi2 = sum(each.line.chi2 for each in segments)
    dof = sum(each.line.points - 2 for each in segments)
    corners = sum(len(lines.corners) for lines in found)
    return (
        name,
        str(len(scans[0].scan.ranges_m)),
        f"{spent_ms:.1f}",
        f"{len(segments) / len(scans):.1f}",
        f"{corners / len(scans):.1f}",
        f"{100 * len(off) / hits:.0f} %",
        f"{1e3 * math.sqrt(float(np.mean(off**2))):.1f}",
        f"{chi2 / dof:.2f}",
        f"{_right_angles(scans, found):.2f}",
    )


def _off(entry: RecordedScan, lines: ScanLines) -> np.ndarray:
    """Return how far the points of a scan lie from their walls [m]."""
    scan = entry.scan
    found = [np.empty(0)]
    for segment in lines.segments:
        beams = segment.beams
        part = replace(scan, angles_rad=scan.angles_rad[beams], ranges_m=scan.ranges_m[beams])
        found.append(segment.line.distances_m(part.points_base()))
    return np.concatenate(found)


def _right_angles(scans: list[RecordedScan], found: list[ScanLines]) -> float:
    """Return how much long walls stand at right angles to each other in `world`, 0 to 1."""
    directions = [
        segment.line.alpha_rad + entry.reference.theta_rad
        for entry, lines in zip(scans, found, strict=True)
        if entry.reference is not None
        for segment in lines.segments
        if segment.length_m > LONG_M
    ]
    return float(abs(np.mean(np.exp(4j * np.array(directions)))))
