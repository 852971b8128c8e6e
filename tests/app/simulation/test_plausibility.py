"""Each contradiction between sensors is put into a simulated robot, and stops it in time."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import Feedback, SafetyState
from robotctl.messages.faults import FaultCode as C
from tests.app.simulation.tampered import Bend, Trial, replace

Said = tuple[C, str]
ROBOTS = ("diff_drive", "tricycle", "ackermann")


Reports = tuple[ActuatorFeedback, ...]


def reports(change: Callable[[Reports, Reports], Reports]) -> Bend:
    """Bend what the actuators report, given also what they reported last before the fault."""
    return lambda feedback, last: replace(
        feedback, actuators=change(feedback.actuators, last.actuators)
    )


def from_there(count: int, start: int, factor: float) -> int:
    """Let counts go on from `start` by a factor of what they really do."""
    moved = (count - start + 0x8000 & 0xFFFF) - 0x8000
    return start + round(factor * moved) & 0xFFFF


def counted(report: ActuatorFeedback, count: int) -> ActuatorFeedback:
    return replace(report, position_ticks=count & 0xFFFF)


def scaled(*factors: float) -> Bend:
    """The counts of each wheel go on by a factor of what they do."""
    return reports(
        lambda now, start: tuple(
            counted(new, from_there(new.position_ticks, old.position_ticks, factor))
            for new, old, factor in zip(now, start, factors, strict=True)
        )
    )


SWAPPED = reports(
    lambda now, start: tuple(
        counted(new, old.position_ticks + other.position_ticks - first.position_ticks)
        for new, old, other, first in zip(now, start, now[::-1], start[::-1], strict=True)
    )
)


def glitches() -> Bend:
    """Every twentieth count of the left wheel is nonsense."""
    seen: dict[int, int] = {}

    def change(now: Reports, _: Reports) -> Reports:
        number = seen.setdefault(now[0].motion_ns, len(seen))
        if number % 20:
            return now
        return (counted(now[0], now[0].position_ticks + 9000), *now[1:])

    return reports(change)


def clock(factor: float) -> Bend:
    """The latch times run by a factor of the real ones, over any number of roll-overs."""
    state = {"start": None, "true": 0, "told": 0.0}

    def change(now: Reports, start: Reports) -> Reports:
        first = start[0].latch_us
        if state["start"] is not start:
            state.update(start=start, true=first, told=0.0)
        state["told"] += factor * (now[0].latch_us - state["true"] & 0xFFFFF)
        state["true"] = now[0].latch_us
        latch_us = first + round(state["told"]) & 0xFFFFF
        return tuple(
            each if each.latch_us < 0 else replace(each, latch_us=latch_us) for each in now
        )

    return reports(change)


STEERING_STUCK = reports(lambda now, last: (now[0], replace(now[1], angle_rad=last[1].angle_rad)))


def front_sonar(range_m: float) -> Bend:
    def bend(feedback: Feedback, _: Feedback) -> Feedback:
        sonars = tuple(
            replace(each, ranges_m=(range_m, *each.ranges_m[1:])) if each.first == 0 else each
            for each in feedback.sonars
        )
        return replace(feedback, sonars=sonars)

    return bend


def told(*places: int, **values: float) -> Bend:
    """Let some actuators report other values."""
    return reports(
        lambda now, _: tuple(
            replace(each, **values) if at in places else each for at, each in enumerate(now)
        )
    )


CASES = {
    # name: robots, bend, velocity, longest time to the stop [s], fault and its part
    "left encoder stuck": ("diff_drive", scaled(0, 1), (0.4, 0.0), 0.12, (C.ENCODER_STUCK, "left")),
    "right encoder stuck": (
        "diff_drive", scaled(1, 0), (-0.4, 0), 0.12, (C.ENCODER_STUCK, "right")),
    "encoder stuck, tricycle": (
        "tricycle", scaled(0, 0), (0.4, 0.3), 0.12, (C.ENCODER_STUCK, "drive")),
    "encoder stuck, ackermann": (
        "ackermann", scaled(0, 0), (0.4, 0), 0.12, (C.ENCODER_STUCK, "drive")),
    "encoder stuck, slow": (
        "diff_drive", scaled(0, 1), (0.08, 0.0), 0.6, (C.ENCODER_STUCK, "left")),
    "left encoder reversed": (
        "diff_drive", scaled(-1, 1), (0.4, 0.0), 0.12, (C.ENCODER_REVERSED, "left")),
    "left encoder reversed, slow": (
        "diff_drive", scaled(-1, 1), (0.08, 0), 0.2, (C.ENCODER_REVERSED, "left")),
    "encoder reversed, tricycle": (
        "tricycle", scaled(-1, 1), (-0.3, 0.0), 0.12, (C.ENCODER_REVERSED, "drive")),
    "encoders swapped, turning": (
        "diff_drive", SWAPPED, (0.0, 1.0), 0.12, (C.ENCODERS_SWAPPED, "")),
    "encoders swapped, arc": (
        "diff_drive", SWAPPED, (0.3, 1.0), 0.35, (C.ENCODERS_SWAPPED, "")),
    "half of the counts lost": (
        "diff_drive", scaled(0.5, 1), (0.4, 0.0), 0.15, (C.ENCODER_WRONG, "left")),
    "a fifth of the counts lost": (
        "diff_drive", scaled(0.8, 1), (0.4, 0.0), 1.2, (C.WHEELS_CONTRADICT, "")),
    "glitches": ("diff_drive", glitches(), (0.4, 0.0), 1.1, (C.ENCODER_JUMPS, "")),
    "clock 5 % fast": ("diff_drive", clock(1.05), (0.2, 0.0), 4.1, (C.CLOCK_DRIFT, "drive")),
    "clock 5 % slow": ("tricycle", clock(0.95), (0.2, 0.0), 4.1, (C.CLOCK_DRIFT, "drive")),
    "front sonar stuck": (
        "diff_drive", front_sonar(2.5), (0.4, 0.0), 1.6, (C.SONAR_STUCK, "front")),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_fault_in_motion_stops_the_robot_in_time_and_says_which(name: str) -> None:
    robot, bend, (v_m_s, omega_rad_s), longest_s, fault = CASES[name]
    trial = Trial(robot).armed()
    trial.drive(v_m_s, omega_rad_s, 1.0)
    assert trial.state == SafetyState.DRIVING, trial.reason
    trial.port.feedback = bend
    took_s = trial.drive(v_m_s, omega_rad_s, longest_s + 2.0)
    assert trial.fault == fault, trial.reason
    assert took_s <= longest_s


def heavy(gear_ratio: float) -> tuple[str, ...]:
    """Settings of 40 kg behind such gears."""
    kv = 0.06 * gear_ratio
    return (
        *("limits.omega_max_rad_s=0.5", "limits.a_max_m_s2=1.0"),
        f"plausibility.back_emf_v_s_rad={kv}",
        *(f"simulation.motor.gear_ratio={gear_ratio}", "simulation.motor.back_emf_v_s_rad=0.06"),
        *("simulation.mass_kg=40.0", "simulation.yaw_inertia_kg_m2=3.0"),
        "simulation.battery.cells=7",
        *(
            f"control.{wheel}.{gain}"
            for wheel in ("left", "right")
            for gain in (f"kp={1.4 * kv}", f"ki={9.0 * kv}", f"kv={kv}", "ks=0.3", f"ka={kv / 20}")
        ),
    )


SLOW = (*heavy(200.0), "limits.v_max_m_s=0.5", "plausibility.speed_tolerance_rad_s=0.625")
"""On wheels of 0.3 m it ends at 0.73 m/s; the widest tolerance allowed."""


def with_wheels(radius_m: float, folder: Path) -> str:
    """The file of a `diff_drive` on such wheels, 0.6 m apart; the simulated robot has them too."""
    text = find_file("diff_drive").read_text(encoding="utf-8")
    for old, new in (("wheel_radius_m = 0.050", radius_m), ("track_width_m = 0.300", 0.6)):
        assert text.count(old) == 1
        text = text.replace(old, f"{old.partition(' ')[0]} = {new}")
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("bend", "v_m_s", "longest_s", "fault"),
    [
        (scaled(0, 0), 0.1, 0.18, (C.ENCODER_STUCK, "left")),
        (scaled(0, 1), -0.1, 0.18, (C.ENCODER_STUCK, "left")),
        (scaled(0, 0), 0.4, 0.08, (C.ENCODER_STUCK, "left")),
        (scaled(0.75, 1), 0.45, 1.2, (C.WHEELS_CONTRADICT, "")),
    ],
)
def test_a_large_slow_wheel_does_not_run_away_behind_a_wrong_encoder(
    tmp_path: Path, bend: Bend, v_m_s: float, longest_s: float, fault: Said
) -> None:
    trial = Trial(with_wheels(0.3, tmp_path), overrides=SLOW).armed()
    trial.drive(v_m_s, 0.0, 1.0)
    trial.port.feedback = bend
    took_s = trial.drive(v_m_s, 0.0, 3.0)
    assert trial.fault == fault, trial.reason
    assert took_s <= longest_s
    assert trial.top_m_s <= abs(v_m_s) + 0.3


def test_a_large_slow_wheel_that_is_sound_is_not_stopped(tmp_path: Path) -> None:
    trial = Trial(with_wheels(0.3, tmp_path), overrides=SLOW).armed()
    for v_m_s, omega_rad_s in ((0.45, 0.0), (-0.45, 0.0), (0.0, 0.5), (0.2, -0.5), (0.02, 0.0)):
        trial.drive(v_m_s, omega_rad_s, 3.0)
        assert trial.state == SafetyState.DRIVING, trial.reason


def test_a_heavy_robot_drives_off_as_fast_as_it_may_and_a_blocked_wheel_still_stops_it(
    tmp_path: Path,
) -> None:
    fast = (*heavy(50.0), "limits.v_max_m_s=1.0")
    trial = Trial(with_wheels(0.17, tmp_path), overrides=fast).armed()
    for v_m_s in (0.8, -0.8, 0.3):
        trial.drive(v_m_s, 0.0, 2.0)
        assert trial.state == SafetyState.DRIVING, trial.reason
    trial.drive(0.0, 0.0, 2.0)
    trial.stack.simulation.faults.inject("wheel_blocked wheel=left")
    assert trial.drive(0.3, 0.0, 2.0) < 0.5
    assert trial.fault == (C.WHEEL_BLOCKED, "left"), trial.reason


@pytest.mark.parametrize(
    ("robot", "bend", "velocity", "fault"),
    [
        ("diff_drive", scaled(0, 1), (0.4, 0.0), (C.ENCODER_STUCK, "left")),
        ("diff_drive", scaled(-1, 1), (0.4, 0.0), (C.ENCODER_REVERSED, "left")),
        ("diff_drive", scaled(-1, -1), (0.4, 0.0), (C.ENCODER_REVERSED, "left")),
        ("diff_drive", SWAPPED, (0.0, 1.0), (C.ENCODERS_SWAPPED, "")),
        ("tricycle", scaled(-1, -1), (0.4, 0.0), (C.ENCODER_REVERSED, "drive")),
        ("ackermann", scaled(0, 0), (-0.4, 0.0), (C.ENCODER_STUCK, "drive")),
    ],
)
def test_a_robot_put_together_wrongly_stops_when_it_first_drives(
    robot: str, bend: Bend, velocity: tuple[float, float], fault: Said
) -> None:
    trial = Trial(robot)
    trial.wait(0.2)
    trial.port.feedback = bend
    trial.armed()
    took_s = trial.drive(*velocity, 1.0)
    assert trial.fault == fault, trial.reason
    assert took_s < 0.25
    assert trial.top_m_s < 0.8


def reversed_by(command: ActuatorCommand, *signs: int) -> ActuatorCommand:
    values = (sign * value for sign, value in zip(signs, command.values, strict=False))
    return replace(command, values=tuple(values))


def test_a_motor_with_its_wires_exchanged_stops_when_it_first_drives() -> None:
    trial = Trial("diff_drive")
    trial.port.command = lambda command: reversed_by(command, -1, 1)
    trial.armed()
    assert trial.drive(0.4, 0.0, 1.0) < 0.25
    assert trial.fault == (C.ENCODER_REVERSED, "left"), trial.reason


def test_a_robot_that_drives_backwards_in_every_respect_is_seen_by_its_sonars() -> None:
    trial = Trial("diff_drive", (3.0, 2.0, 0.0))
    negated = scaled(-1, -1)

    def mirror(feedback: Feedback, last: Feedback) -> Feedback:
        feedback = negated(feedback, last)
        turned = (
            replace(each, current_a=-each.current_a) if each.current_a is not None else each
            for each in feedback.actuators
        )
        return replace(feedback, actuators=tuple(turned))

    trial.wait(0.2)
    trial.port.feedback = mirror
    trial.port.command = lambda c: reversed_by(c, -1, -1)
    trial.armed()
    took_s = trial.drive(0.3, 0.0, 4.0)
    assert trial.fault == (C.ODOMETRY_REVERSED, ""), trial.reason
    assert took_s < 2.0


@pytest.mark.parametrize("robot", ["tricycle", "ackermann"])
def test_steering_that_stays_where_it_is_stops_the_robot(robot: str) -> None:
    trial = Trial(robot, (2.0, 1.0, 0.0)).armed()
    trial.drive(0.3, 0.0, 1.0)
    trial.port.feedback = STEERING_STUCK
    assert trial.drive(0.3, 0.5, 2.0) < 1.0
    assert trial.fault == (C.STEERING_OFF, ""), trial.reason


@pytest.mark.parametrize("heading_rad", [0.0, 0.5])
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_wall_stops_the_robot_that_pushes_against_it(robot: str, heading_rad: float) -> None:
    trial = Trial(robot, (4.3, 2.0, heading_rad)).armed()
    while trial.stack.simulation.truth().collisions == 0:
        assert trial.drive(0.4, 0.0, 0.05) == 0.05, trial.reason
    took_s = trial.drive(0.4, 0.0, 3.0)
    assert trial.fault[0] in {C.WHEEL_PUSHES, C.WHEEL_BLOCKED}, trial.reason
    assert took_s < 0.8


def test_a_wheel_that_cannot_turn_is_blocked_and_no_broken_encoder() -> None:
    trial = Trial("diff_drive", (5.81, 2.0, 0.0), ("simulation.wheels.friction=5.0",)).armed()
    took_s = trial.drive(0.4, 0.0, 3.0)
    assert trial.fault[0] == C.WHEEL_BLOCKED, trial.reason
    assert took_s < 1.5


def test_slipping_wheels_in_front_of_a_wall_are_seen_by_sonar_where_the_push_is_weak() -> None:
    weak = ("simulation.wheels.friction=0.15",)
    trial = Trial("diff_drive", (5.0, 2.0, 0.0), weak).armed()
    trial.drive(0.4, 0.0, 5.0)
    assert trial.fault[0] == C.WHEELS_SLIP, trial.reason


@pytest.mark.parametrize(
    ("bend", "fault"),
    [
        (told(0, temperature_c=-40.0), (C.TEMPERATURE_WRONG, "left")),
        (told(1, temperature_c=200.0), (C.TEMPERATURE_WRONG, "right")),
        (told(0, current_a=1.5), (C.CURRENT_WRONG, "left")),
        (told(1, current_a=-102.4), (C.CURRENT_WRONG, "right")),
        (told(0, 1, voltage_v=7.0), (C.SUPPLY_WRONG, "")),
        (told(0, 1, voltage_v=math.nan), (C.SUPPLY_WRONG, "")),
        (reports(lambda _, last: last), (C.WHEELS_STALE, "drive")),
    ],
)
def test_an_implausible_sensor_keeps_the_robot_from_arming(bend: Bend, fault: Said) -> None:
    trial = Trial("diff_drive")
    trial.wait(1.0)
    trial.port.feedback = bend
    trial.wait(0.1)
    trial.arm()
    ack = trial.stack.snapshot().acks[-1]
    assert not ack.accepted
    assert fault in {(reason.code, reason.part) for reason in ack.reasons}, ack.reasons
    assert trial.state == SafetyState.STANDBY


@pytest.mark.parametrize("robot", ["diff_drive", "ackermann"])
def test_no_monitor_stops_a_mission_of_a_heavier_robot_with_more_friction_and_a_used_battery(
    robot: str,
) -> None:
    path = find_file(robot)
    mass_kg = 1.3 * load_robot(path).simulation["mass_kg"]
    overrides = (
        f"simulation.mass_kg={mass_kg}",
        "simulation.battery.charge=0.25",
        "simulation.motor.coulomb_n_m=0.006",
        "simulation.wheels.rolling_resistance=0.04",
    )
    mission = find_file("patrol", "missions")
    report = run_lockstep(SimOptions(path, mission, seed=3, overrides=overrides))
    assert report.mission_completed, report.message
