"""How well a run went: the mission, the estimate against the truth, the loop and the bus."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec

from robotctl.model.angles import wrap_angle
from robotctl.runtime.messages import BusStatus, ControlState, LoopStatistics, NavigationState
from robotctl.runtime.safety import LATCHED, POWERED


class PoseError(msgspec.Struct, frozen=True):
    """Distance between estimated and true position [m], and the final heading error [rad]."""

    rmse_m: float
    max_m: float
    final_m: float
    final_rad: float


class Report(msgspec.Struct, frozen=True):
    """The result of one simulated run, written as JSON.

    `unsafe_motions` counts what the simulator's monitor holds against the robot: power at the
    wheels that nothing on the bus allowed, or too much speed; `unsafe_reason` is that of the last.
    `faults` are those of the scenario that have begun, each with the simulator's time.
    """

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
    unsafe_motions: int
    unsafe_reason: str
    pose_error: PoseError
    loop: dict[str, Any]
    bus: dict[str, Any]
    real_time_factor: float
    faults: tuple[str, ...] = ()

    def json(self) -> bytes:
        """Return the report as indented JSON."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"


AT_REST_M_S = 0.01


def is_over(control: ControlState | None, navigation: NavigationState | None) -> bool:
    """Return whether a run has ended: stopped for good, or mission over and the robot at rest."""
    if control is None:
        return False
    if control.state in LATCHED:
        return True
    return (
        navigation is not None
        and (navigation.mission_completed or navigation.mission_failed)
        and abs(control.v_m_s) < AT_REST_M_S
    )


def run_message(control: ControlState, navigation: NavigationState | None) -> str:
    """Return the line that explains how a run stands: why it cannot drive, else what it does."""
    if control.state not in POWERED:
        refused = control.ack.reasons if control.ack is not None else ()
        reason = control.reason or "; ".join(refused)
        if reason:
            return f"{control.state.name.lower().replace('_', ' ')}: {reason}"
    return navigation.message if navigation is not None else ""


class StampedPose(NamedTuple):
    """A pose of `base` in `world` and its time."""

    stamp_ns: int
    x_m: float
    y_m: float
    theta_rad: float


class PoseScore:
    """Compares estimates with the truth interpolated to their time.

    Both streams must come in the order of their stamps, each at its own pace.
    """

    def __init__(self) -> None:
        self._truths: deque[StampedPose] = deque()
        self._estimates: deque[StampedPose] = deque()
        self._squares = 0.0
        self._count = 0
        self._max_m = 0.0
        self._final_m = 0.0
        self._final_rad = 0.0

    def truth(self, pose: StampedPose) -> None:
        """Add a true pose."""
        self._truths.append(pose)
        self._match()

    def estimate(self, pose: StampedPose) -> None:
        """Add an estimated pose."""
        self._estimates.append(pose)
        self._match()

    def _match(self) -> None:
        """Score each estimate that lies between two truths."""
        truths, estimates = self._truths, self._estimates
        while estimates and truths and truths[-1].stamp_ns >= estimates[0].stamp_ns:
            estimate = estimates.popleft()
            while len(truths) > 1 and truths[1].stamp_ns <= estimate.stamp_ns:
                truths.popleft()
            if truths[0].stamp_ns <= estimate.stamp_ns:
                self._add(estimate, _interpolate(truths, estimate.stamp_ns))

    def _add(self, estimate: StampedPose, truth: StampedPose) -> None:
        """Score one pair."""
        distance_m = math.hypot(estimate.x_m - truth.x_m, estimate.y_m - truth.y_m)
        self._squares += distance_m * distance_m
        self._count += 1
        self._max_m = max(self._max_m, distance_m)
        self._final_m = distance_m
        self._final_rad = abs(wrap_angle(estimate.theta_rad - truth.theta_rad))

    def result(self) -> PoseError:
        """Return the errors so far; all 0 where nothing was compared."""
        rmse_m = math.sqrt(self._squares / self._count) if self._count else 0.0
        return PoseError(rmse_m, self._max_m, self._final_m, self._final_rad)


def _interpolate(truths: Sequence[StampedPose], stamp_ns: int) -> StampedPose:
    """Return the pose at `stamp_ns` between the first two truths."""
    first = truths[0]
    if first.stamp_ns == stamp_ns or len(truths) == 1:
        return first
    second = truths[1]
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    return StampedPose(
        stamp_ns,
        first.x_m + share * (second.x_m - first.x_m),
        first.y_m + share * (second.y_m - first.y_m),
        wrap_angle(first.theta_rad + share * wrap_angle(second.theta_rad - first.theta_rad)),
    )


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
