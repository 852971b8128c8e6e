"""Score of a run: the mission, the estimate against the truth, the loop and the bus."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, Final, Generic, NamedTuple, TypeVar

import msgspec

from firmware_sim.faults.parameters import FAILED
from robotctl.messages.control import BusStatus, ControlState, LoopStatistics, NavigationState
from robotctl.model.drives.motion import between
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.goto import GotoItem
from robotctl.planning.behave.behaviours.goto_place import GotoPlaceItem
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.safety.causes import AFTER_NS
from robotctl.safety.state_machine import LATCHED, POWERED

T = TypeVar("T")

_LATEST_NS: Final = 60_000_000_000
"""Maximum delay of a pose to be compared [ns]."""


class PoseError(msgspec.Struct, frozen=True):
    """Distance between estimated and true position [m], and errors of the heading [rad]."""

    rmse_m: float
    max_m: float
    final_m: float
    final_rad: float
    heading_rmse_rad: float


class LocalisationReport(msgspec.Struct, frozen=True):
    """Score of the localiser.

    Attributes
    ----------
    method
        As configured.
    localised_after_s
        From the first estimate until it first said that it was localised and was right [s]; None:
        never. Right is within 0.5 m and 0.5 rad.
    localised_share
        Share of the time since then in which it said so.
    wrong_s
        Time in which it claimed so and was wrong [s].
    error
        While it said so, since it first was right.
    nees_inside_95, nis_inside_95
        Share of the estimates and of the innovations inside the two-sided 95 % bounds of their χ²
        distribution; None if there are none.
    nees_above_95
        Share of the estimates above those bounds, which were too sure; the others outside were too
        modest.
    odometry_rmse_m
        Error of odometry alone [m].
    step_ms
        Its part of a navigation step, median [ms].
    """

    method: str
    localised_after_s: float | None
    localised_share: float
    wrong_s: float
    error: PoseError
    nees_inside_95: float | None
    nis_inside_95: float | None
    nees_above_95: float | None
    odometry_rmse_m: float
    step_ms: float


class SlamReport(msgspec.Struct, frozen=True):
    """Score of a drive by SLAM, as the robot believed it at each time.

    Attributes
    ----------
    ape_m
        Position error after the turn and shift that fit the true trajectory best, rmse [m].
    rpe_m, rpe_rad
        Error of the motion on each metre of the way, rmse [m], [rad]; nan if it was shorter.
    loops, false_loops
        Places that were known again, as links of the graph, and those of them more than 0.5 m or
        0.2 rad off.
    verdict
        How good the map is by the localiser's own last word, and why it is no better; empty if it
        says nothing.
    """

    ape_m: float
    rpe_m: float
    rpe_rad: float
    loops: int
    false_loops: int
    verdict: str = ""


class MapQuality(msgspec.Struct, frozen=True):
    """Occupied cells of the map against what stands in the world, within one cell.

    Attributes
    ----------
    precision
        Share of the occupied cells that lie on a wall or another thing.
    recall
        Share of the walls and things that are in the map, of those that its sensor could see from
        anywhere that the robot can reach.
    aligned_precision, aligned_recall
        The same of the map laid over the walls: `world` is where the robot starts, and a heading
        that is a little wrong there turns the whole map.
    """

    precision: float
    recall: float
    aligned_precision: float
    aligned_recall: float


class CameraReport(msgspec.Struct, frozen=True):
    """Camera detections against the truth, up to 3 m; None if there was nothing.

    Attributes
    ----------
    pictures, untrusted
        Looked at, and of those the ones that were not judged.
    range_error
        Median of the error of a range, as a share of it; a beam that goes on where something
        stands has an infinite one.
    within_3_sigma
        Share of these beams whose error is within three of their standard deviations.
    obstacles, found, false
        Things of the floor within 2 m, once for each judged picture that shows all of the foot
        (95 % and more), those of them that were reported, and reports where nothing stands.
    obstacle_rmse_m
        Of the position of the foot of those found [m].
    step_ms
        Processor's time for a picture, median [ms].
    """

    pictures: int
    untrusted: int
    range_error: float | None
    within_3_sigma: float | None
    obstacles: int
    found: int
    false: int
    obstacle_rmse_m: float | None
    step_ms: float


class Truth(msgspec.Struct, frozen=True):
    """The part of firmware_sim's published truth that scores a run."""

    stamp_ns: int
    x_m: float
    y_m: float
    theta_rad: float
    distance_m: float
    collisions: int
    power_off_ns: int
    unsafe_motions: int
    unsafe_reason: str
    late_max_ns: int
    ran_into: int
    people: tuple[tuple[float, float], ...]
    body: int


class Report(msgspec.Struct, frozen=True):
    """The result of one simulated run, written as JSON.

    `message` is what the robot said last, `ended` why the run ended: with the robot's last word, by
    `--max-seconds` or by the user; empty while it goes on.
    `unsafe_motions` counts what the simulator's monitor holds against the robot: power at the
    wheels that nothing on the bus allowed, or too much speed; `unsafe_reason` is that of the last.
    `held_up_ms` is how long this computer was held up at most, by an estimate of its own. `silent`
    names the processes that had said nothing for a while at the end: what is reported of them is of
    before. `faults`
    are those of the scenario whose time has come, each with the simulator's time, and why where it
    could not begin; then those that never began, since the run was over before their time.
    `collisions` are those that the robot causes; `ran_into` counts people who ran into it.
    `arrived` says so of a mission of one `goto`, None of others; `time_s` is from when the robot
    set off until the end, None if it never did; `best_m` and `best_s` are length and time of the
    best path, see `best_path`, `time_by_best` the quotient of a completed mission;
    `min_clearance_m` is the smallest distance of its body from what stands around, None where
    nothing does; near misses are nearer than 5 cm by its own motion; `plans` and `recoveries` are
    those of driving by plan. `log_trouble` names logs, truth or map that could not be written.
    `pose_error` is that of the pose that the robot goes by; `localisation`, `map_quality` and
    `camera` are None without a localiser, without mapping and without a camera.
    """

    robot: str
    world: str
    mission: str
    seed: int
    bus_kind: str
    mission_completed: bool
    message: str
    ended: str
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
    held_up_ms: float = 0.0
    silent: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    log_trouble: str = ""
    localisation: LocalisationReport | None = None
    slam: SlamReport | None = None
    map_quality: MapQuality | None = None
    camera: CameraReport | None = None
    ran_into: int = 0
    arrived: bool | None = None
    time_s: float | None = None
    best_m: float | None = None
    best_s: float | None = None
    time_by_best: float | None = None
    min_clearance_m: float | None = None
    near_misses: int = 0
    plans: int = 0
    recoveries: int = 0

    @property
    def failed_faults(self) -> tuple[str, ...]:
        """Faults of `faults` that did not begin: the run has not tested them."""
        return tuple(each for each in self.faults if FAILED in each)

    @property
    def passed(self) -> bool:
        """Whether the mission was completed, under all the faults that were to befall the robot."""
        return self.mission_completed and not self.failed_faults

    def json(self) -> bytes:
        """Return the report as indented JSON."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"


AT_REST_M_S = 0.01


def is_over(control: ControlState | None, navigation: NavigationState | None) -> bool:
    """Return whether a run has ended: stopped for good, or mission over and the robot at rest.

    A stop is for good once its cause is known, as far as it will be.
    """
    if control is None:
        return False
    if control.state in LATCHED:
        return control.stamp_ns - control.stopped_ns > AFTER_NS
    return (
        navigation is not None
        and (navigation.mission_completed or navigation.mission_failed)
        and abs(control.v_m_s) < AT_REST_M_S
    )


def run_message(control: ControlState, navigation: NavigationState | None) -> str:
    """Return the line on the state of a run: why it cannot drive, otherwise what it is doing."""
    if control.state not in POWERED:
        refused = control.acks[-1].reasons if control.acks else ()
        reason = control.reason or "; ".join(map(str, refused))
        if reason:
            return f"{control.state.name.lower().replace('_', ' ')}: {reason}"
    return navigation.message if navigation is not None else ""


class StampedPose(NamedTuple):
    """A pose of `base` in `world` and its time."""

    stamp_ns: int
    x_m: float
    y_m: float
    theta_rad: float

    @property
    def pose(self) -> SE2:
        """The pose alone."""
        return SE2(self.x_m, self.y_m, self.theta_rad)

    def distance_m(self, other: StampedPose) -> float:
        """Return the distance between two positions [m]."""
        return math.hypot(self.x_m - other.x_m, self.y_m - other.y_m)


class TruthMatcher(Generic[T]):
    """Pairs poses with the truth interpolated to their time.

    Both streams must come in the order of their stamps, each at its own pace. A pose carries
    whatever belongs to it, and comes within a minute of its stamp: older truths are forgotten.
    """

    def __init__(self) -> None:
        self._truths: deque[StampedPose] = deque()
        self._poses: deque[tuple[StampedPose, T]] = deque()

    def truth(self, pose: StampedPose) -> Iterator[tuple[StampedPose, T, StampedPose]]:
        """Add a true pose; yield the pairs that are complete now."""
        self._truths.append(pose)
        if not self._poses:
            while self._truths[0].stamp_ns < pose.stamp_ns - _LATEST_NS:
                self._truths.popleft()
        return self._matched()

    def pose(self, pose: StampedPose, what: T) -> Iterator[tuple[StampedPose, T, StampedPose]]:
        """Add a pose with its data; yield the pairs that are now complete."""
        self._poses.append((pose, what))
        return self._matched()

    def _matched(self) -> Iterator[tuple[StampedPose, T, StampedPose]]:
        """Yield each pose between two true ones."""
        truths, poses = self._truths, self._poses
        while poses and truths and truths[-1].stamp_ns >= poses[0][0].stamp_ns:
            pose, what = poses.popleft()
            while len(truths) > 1 and truths[1].stamp_ns <= pose.stamp_ns:
                truths.popleft()
            if truths[0].stamp_ns <= pose.stamp_ns:
                yield pose, what, _interpolate(truths, pose.stamp_ns)


class PoseScore:
    """Compares estimates with the truth of their time."""

    def __init__(self) -> None:
        self._matcher: TruthMatcher[None] = TruthMatcher()
        self._squares = 0.0
        self._heading_squares = 0.0
        self._count = 0
        self._max_m = 0.0
        self._final_m = 0.0
        self._final_rad = 0.0

    def truth(self, pose: StampedPose) -> None:
        """Add a true pose; they must come in the order of their stamps."""
        for estimate, _, truth in self._matcher.truth(pose):
            self.add(estimate, truth)

    def estimate(self, pose: StampedPose) -> None:
        """Add an estimated pose; they must come in the order of their stamps."""
        for estimate, _, truth in self._matcher.pose(pose, None):
            self.add(estimate, truth)

    def add(self, estimate: StampedPose, truth: StampedPose) -> None:
        """Score a pair of one time."""
        distance_m = estimate.distance_m(truth)
        turned_rad = wrap_angle(estimate.theta_rad - truth.theta_rad)
        self._squares += distance_m * distance_m
        self._heading_squares += turned_rad * turned_rad
        self._count += 1
        self._max_m = max(self._max_m, distance_m)
        self._final_m = distance_m
        self._final_rad = abs(turned_rad)

    def result(self) -> PoseError:
        """Return the errors so far; all 0 if nothing was compared."""
        count = max(1, self._count)
        return PoseError(
            rmse_m=math.sqrt(self._squares / count),
            max_m=self._max_m,
            final_m=self._final_m,
            final_rad=self._final_rad,
            heading_rmse_rad=math.sqrt(self._heading_squares / count),
        )


def _interpolate(truths: Sequence[StampedPose], stamp_ns: int) -> StampedPose:
    """Return the pose at `stamp_ns` between the first two truths."""
    first = truths[0]
    if first.stamp_ns == stamp_ns or len(truths) == 1:
        return first
    second = truths[1]
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    pose = between(first.pose, second.pose, share)
    return StampedPose(stamp_ns, pose.x_m, pose.y_m, pose.theta_rad)


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


def arrived(mission: Mission, navigation: NavigationState | None) -> bool | None:
    """Return whether the robot is at the goal of its mission; None of a mission with more items."""
    if navigation is None or len(mission.item) != 1:
        return None
    if not isinstance(mission.item[0], GotoItem | GotoPlaceItem):
        return None
    return navigation.mission_completed
