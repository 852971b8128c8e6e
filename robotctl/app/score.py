"""How well a run went: the mission, the estimate against the truth, the loop and the bus."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from robotctl.model.angles import wrap_angle
from robotctl.runtime.messages import BusStatus, LoopStatistics


class PoseError(msgspec.Struct, frozen=True):
    """Distance between estimated and true position [m], and the final heading error [rad]."""

    rmse_m: float
    max_m: float
    final_m: float
    final_rad: float


class Report(msgspec.Struct, frozen=True):
    """The result of one simulated run, written as JSON."""

    robot: str
    world: str
    mission: str
    seed: int
    bus_kind: str
    mission_completed: bool
    message: str
    items_done: int
    items: int
    duration_s: float
    distance_m: float
    collisions: int
    pose_error: PoseError
    loop: dict[str, Any]
    bus: dict[str, Any]
    real_time_factor: float

    def json(self) -> bytes:
        """Return the report as indented JSON."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"


class PoseScore:
    """Collects pose errors of a run."""

    def __init__(self) -> None:
        self._squares = 0.0
        self._count = 0
        self._max_m = 0.0
        self._final_m = 0.0
        self._final_rad = 0.0

    def add(self, estimate: tuple[float, float, float], truth: tuple[float, float, float]) -> None:
        """Compare two poses (x [m], y [m], theta [rad]) of the same moment in the same frame."""
        distance_m = math.hypot(estimate[0] - truth[0], estimate[1] - truth[1])
        self._squares += distance_m * distance_m
        self._count += 1
        self._max_m = max(self._max_m, distance_m)
        self._final_m = distance_m
        self._final_rad = abs(wrap_angle(estimate[2] - truth[2]))

    def result(self) -> PoseError:
        """Return the errors so far; all 0 where nothing was compared."""
        rmse_m = math.sqrt(self._squares / self._count) if self._count else 0.0
        return PoseError(rmse_m, self._max_m, self._final_m, self._final_rad)


def loop_report(loop: LoopStatistics) -> dict[str, Any]:
    """Return the loop's part of the report."""
    return {
        "rate_hz": loop.rate_hz,
        "ticks": loop.ticks,
        "overruns": loop.overruns,
        "overrun_causes": loop.overrun_causes,
        "lag_us": {
            "p50": loop.lag_us_p50,
            "p99": loop.lag_us_p99,
            "p999": loop.lag_us_p999,
            "max": loop.lag_us_max,
        },
        "step_us": {"p50": loop.step_us_p50, "p99": loop.step_us_p99},
        "stage_us": {
            "p50": loop.stage_us_p50,
            "p99": loop.stage_us_p99,
        },
    }


def bus_report(bus: BusStatus) -> dict[str, Any]:
    """Return the bus's part of the report, as the robot's side saw it."""
    return {
        "frames": bus.received + bus.sent,
        "load": round(bus.load, 4),
        "errors": bus.error_frames + bus.send_failures + bus.crc_rejects + bus.counter_rejects,
    }
