"""Steps: reactions of sonars, IMU and emergency stop to the person's actions."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import median
from typing import Final

from robotctl.deploy.doctor_imu import check_imu
from robotctl.deploy.setup.bench import Bench
from robotctl.deploy.setup.dialogue import NO_CHANGES, Ask, Script, Tell, Topic, UnfinishedError
from robotctl.deploy.setup.steps.asking import again_or_give_up, in_service
from robotctl.estimation.inertial.tracker import InertialTracker
from robotctl.messages.actuators import DriveState
from robotctl.messages.control import ImuFeedback

HAND_M: Final = 0.2
"""Distance of the hand before a sonar [m]."""
LOOK_S: Final = 1.5
"""Duration of a measurement [s]."""
TILTED_DEG: Final = 8.0
"""Minimum tilt to recognise [deg]."""
TURNED_DEG: Final = 20.0
"""Minimum turn to recognise [deg]."""


def sonars(bench: Bench) -> Script:
    """Hold a hand before each sonar, which must be the one that detects it."""
    mounts = bench.config.sonar
    if not mounts:
        yield Tell("This robot has no sonars.")
        return NO_CHANGES
    yield from in_service(bench)
    yield Ask(Topic.AWAY, "Stand back, so that nothing is near the sonars.")
    free_m = _ranges(bench)
    for number, mount in enumerate(mounts):
        while True:
            text = f"Hold a hand {HAND_M:g} m before the sonar {mount.name}, and press Enter."
            yield Ask(Topic.HAND, text, subject=mount.name)
            seen_m = _ranges(bench)
            nearer = [
                each
                for each in range(len(mounts))
                if seen_m[each] < min(2.0 * HAND_M, free_m[each] - 0.5 * HAND_M)
            ]
            found = min(nearer, key=lambda each: seen_m[each], default=None)
            if found == number:
                yield Tell(f"{mount.name} sees it at {seen_m[number]:.2f} m.")
                break
            who = "no sonar" if found is None else mounts[found].name
            remedy = (
                "See that it is connected and looks where its table [[sonar]] says; the tables "
                "have the order of the sonars at their node"
            )
            yield from again_or_give_up(f"the hand before {mount.name} is seen by {who}", remedy)
    return NO_CHANGES


def _ranges(bench: Bench) -> list[float]:
    """Return the median range of each sonar over `LOOK_S` [m]: single ones may be crosstalk."""
    heard: list[list[float]] = [[] for _ in bench.config.sonar]
    end_ns = bench.now_ns + round(LOOK_S * 1e9)
    while bench.now_ns < end_ns:
        for frame in bench.rest().sonars:
            for number, range_m in enumerate(frame.ranges_m, frame.first):
                if number < len(heard) and not math.isnan(range_m):
                    heard[number].append(range_m)
    return [median(each) if each else math.inf for each in heard]


def imu(bench: Bench) -> Script:
    """Tilt and turn the robot by hand; the IMU must report the same."""
    mount = bench.config.imu
    if not mount.enabled:
        yield Tell("This robot has no IMU.")
        return NO_CHANGES
    yield from in_service(bench)
    yield Ask(Topic.LEVEL, "Stand the robot level and leave it alone.")
    finding = check_imu(_look(bench), mount)
    yield Tell(finding.found)
    if finding.fix:
        raise UnfinishedError(f"{finding.found}: {finding.fix}")
    tests: tuple[tuple[Topic, str, str, Callable[[ImuFeedback], float]], ...] = (
        # Leaning forwards, "up" points backwards in base.
        (Topic.TILT, "forwards", "Tilt the robot forwards, by 20 degrees", _pitch_deg),
        (Topic.TILT, "left", "Tilt the robot to its left side, by 20 degrees", _roll_deg),
    )
    for topic, way, text, measure in tests:
        while True:
            yield Ask(topic, f"{text}, hold it so, and press Enter.", subject=way)
            found = _look(bench)
            tilt_deg = 0.0 if found is None else measure(found)
            if tilt_deg > TILTED_DEG:
                yield Tell(f"Tilted {way} by {tilt_deg:.0f} degrees.")
                break
            remedy = "See how the IMU is mounted, z up, and imu.yaw_deg: where its x axis points"
            problem = f"the IMU says {tilt_deg:.0f} degrees {way}, at least {TILTED_DEG:g} allowed"
            yield from again_or_give_up(problem, remedy)
    yield from _turn_left(bench)
    return NO_CHANGES


def _turn_left(bench: Bench) -> Script:
    """Have the robot turned to the left, and check the gyro."""
    while True:
        yield Ask(Topic.LEVEL, "Put it level again and leave it alone.")
        tracker, turned_rad, last_ns = InertialTracker(bench.config.imu), 0.0, 0
        text = "Press Enter, and then turn the robot to the left by a quarter within five seconds."
        yield Ask(Topic.TURN_LEFT, text)
        end_ns = bench.now_ns + 5_000_000_000
        while bench.now_ns < end_ns:
            feedback = bench.rest()
            tracker.update(feedback.gyro, feedback.accelerometer, 0.0, 0.0)
            found = tracker.latest
            if found is not None and found.gyro_stamp_ns > last_ns:
                if last_ns:
                    step_s = (found.gyro_stamp_ns - last_ns) * 1e-9
                    turned_rad += found.rate_rad_s[2] * step_s
                last_ns = found.gyro_stamp_ns
        turned_deg = math.degrees(turned_rad)
        if turned_deg > TURNED_DEG:
            yield Tell(f"Turned to the left by {turned_deg:.0f} degrees.")
            return NO_CHANGES
        yield from again_or_give_up(
            f"the IMU says {turned_deg:.0f} degrees to the left, at least {TURNED_DEG:g} allowed",
            "See that its z axis points up",
        )


def _look(bench: Bench) -> ImuFeedback | None:
    """Return the IMU's feedback of a robot at rest."""
    tracker = InertialTracker(bench.config.imu)
    end_ns = bench.now_ns + round(LOOK_S * 1e9)
    while bench.now_ns < end_ns:
        feedback = bench.rest()
        tracker.update(feedback.gyro, feedback.accelerometer, 0.0, 0.0)
    return tracker.latest


def _pitch_deg(found: ImuFeedback) -> float:
    """Return the tilt forwards [deg]."""
    return math.degrees(math.atan2(-found.up[0], found.up[2]))


def _roll_deg(found: ImuFeedback) -> float:
    """Return the tilt to the left [deg]."""
    return math.degrees(math.atan2(-found.up[1], found.up[2]))


def emergency_stop(bench: Bench) -> Script:
    """Have the emergency stop pressed and released, and check both."""
    yield from in_service(bench)
    while True:
        yield Ask(Topic.PRESS, "Press the emergency stop, and press Enter.")
        seen = _stopped(bench)
        if seen:
            yield Tell(f"Seen: {seen}.")
            break
        yield from again_or_give_up(
            "nothing shows that the emergency stop is pressed",
            "Every drive should lose its supply, or report a stop. Without a button: give up",
        )
    while True:
        yield Ask(Topic.RELEASE, "Release it again, and press Enter.")
        bench.commission()
        if bench.recover() and not any(status.problem for status in bench.statuses):
            yield Tell("All drives are ready again.")
            return NO_CHANGES
        seen = _stopped(bench) or "a drive is not ready"
        yield from again_or_give_up(seen, "Release the emergency stop, or switch off and on")


def _stopped(bench: Bench) -> str:
    """Return how the drives report their stop; empty unless all do."""
    end_ns = bench.now_ns + round(LOOK_S * 1e9)
    while bench.now_ns < end_ns:
        bench.rest()
    if bench.feedback.emergency_stop is not None:
        return "emergency stop on the bus"
    shown = []
    for motor, drive, _ in bench.drives:
        states = {report.state for report in drive.reports}
        if drive.status.problem:
            shown.append(f"{motor.name} is off the bus")
        elif states & {DriveState.EMERGENCY_STOP, DriveState.STOPPED, DriveState.FAULT}:
            shown.append(f"{motor.name}: {', '.join(sorted(each.name.lower() for each in states))}")
        else:
            return ""
    return "; ".join(shown)
