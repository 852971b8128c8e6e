"""Robots with more wheels than our own controller has channels, in the whole simulation."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from firmware_sim.config.config import RobotConfig
from firmware_sim.errors import SimulationError
from firmware_sim.faults.catalogue import CATALOGUE
from firmware_sim.faults.monitor import Kind
from firmware_sim.plant.axis import Limits, Mode
from firmware_sim.simulation import Simulation
from firmware_sim.world.world import load_world
from tests.firmware_sim.plant.plants import mecanum, omni, skid_steer

CONFIGS = Path(__file__).parents[2] / "configs"
ROOM = load_world(CONFIGS / "worlds" / "empty_room.toml")
MS = 1_000_000
ROBOTS = {
    "skid_steer": skid_steer(),
    "skid_steer of six": skid_steer(wheels_per_side=3),
    "mecanum": mecanum(),
    "omni": omni(),
}
NAMES = (
    "the mecanum drive has no such wheel, allowed: front_left, front_right, rear_left, "
    "rear_right, left, right, drive"
)
STRAFE = (-5.0, 5.0, 5.0, -5.0)


class Rover:
    """A simulated robot whose wheels have speed loops, and what its drives read."""

    def __init__(self, config: RobotConfig, seed: int = 1) -> None:
        self.simulation = Simulation(config, ROOM, seed, start=(2.0, 2.0, 0.0))
        self.plant = self.simulation.plant
        self.axes = self.simulation.faults.stage.axes
        self.encoders = [axis.encoder(4096) for axis in self.axes]
        for axis in self.axes:
            axis.limits = Limits(kp_a_s_rad=10.0, ki_a_rad=100.0)
        self.run(20)

    def run(self, milliseconds: int) -> None:
        self.simulation.advance(self.simulation.now_ns + milliseconds * MS)

    def drive(self, speeds: tuple[float, ...], milliseconds: int = 1000) -> None:
        for axis, speed in zip(self.axes, speeds, strict=True):
            axis.command(Mode.SPEED, speed)
        self.run(milliseconds)
        self.simulation.truth()

    def begin(self, line: str) -> None:
        self.simulation.faults.inject(line)

    @property
    def true_speeds(self) -> list[float]:
        return [axis.speed_rad_s for axis in self.plant.axes]


@pytest.fixture
def rover() -> Rover:
    return Rover(ROBOTS["mecanum"])


def test_the_truth_tells_that_a_robot_moves_sideways(rover: Rover) -> None:
    rover.drive(STRAFE)
    truth = rover.simulation.truth()
    assert truth.vy_m_s == pytest.approx(0.4, rel=0.01)
    assert truth.v_m_s == pytest.approx(0.0, abs=1e-3)
    assert truth.y_m > 2.3
    assert truth.distance_m == pytest.approx(truth.y_m - 2.0, rel=1e-3)


def test_a_robot_that_strafes_is_stopped_by_a_wall_beside_it(rover: Rover) -> None:
    rover.drive(STRAFE, 12_000)
    truth = rover.simulation.truth()
    assert truth.collisions == 1
    wall = max(segment[1] for segment in ROOM.segments)
    assert truth.y_m == pytest.approx(wall - 0.25, abs=0.01)


def test_our_controller_is_absent_and_so_are_faults_of_it(rover: Rover) -> None:
    assert [node.name for node in rover.simulation.nodes] == ["power"]
    for line, problem in (
        ("node_reset node=drive", "node: 'drive', the robot has none, allowed: power"),
        ("feedback_lost", "kind: the robot has no motor controller of this kind"),
        (
            "parameter_changed parameter=current_limit",
            "parameter: 'current_limit', of 'drive', the robot has none, allowed: power",
        ),
    ):
        with pytest.raises(SimulationError) as error:
            rover.begin(line)
        assert str(error.value) == f"fault {line.partition(' ')[0]}: {problem}"
    rover.begin("parameter_changed parameter=battery_low value=11000")


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        (
            "wheel_blocked wheel=middle_left",
            f"wheel: 'middle_left', {NAMES}; did you mean \"rear_left\"?",
        ),
        (
            "wheels_swapped wheel=rear_left other=rear_left",
            "other: 'rear_left', must be another wheel",
        ),
        (
            "wheels_swapped wheel=wheel_9",
            f"wheel: 'wheel_9', {NAMES}",
        ),
    ],
)
def test_a_wheel_that_the_robot_has_not_is_refused_with_those_it_has(
    rover: Rover, line: str, problem: str
) -> None:
    with pytest.raises(SimulationError) as error:
        rover.begin(line)
    assert str(error.value) == f"fault {line.partition(' ')[0]}: {problem}"


@pytest.mark.parametrize("config", ROBOTS.values(), ids=ROBOTS)
def test_any_wheel_is_blocked_by_its_name(config: RobotConfig) -> None:
    for number, name in enumerate(config.drive.wheel_names):
        rover = Rover(config)
        rover.drive(tuple([3.0] * len(rover.axes)), 300)
        rover.begin(f"wheel_blocked wheel={name}")
        rover.run(300)
        rover.simulation.truth()
        speeds = rover.true_speeds
        assert speeds.pop(number) == 0.0
        assert speeds == pytest.approx([3.0] * len(speeds), abs=0.3)
        assert rover.axes[number].current_a == pytest.approx(20.0, rel=0.05)


def test_an_encoder_that_stands_still_deceives_its_drive_until_it_gives_all_it_has(
    rover: Rover,
) -> None:
    rover.drive((3.0, 3.0, 3.0, 3.0))
    before = [encoder.count for encoder in rover.encoders]
    rover.begin("encoder_stuck wheel=rear_right")
    rover.run(300)
    rover.simulation.truth()
    after = [encoder.count for encoder in rover.encoders]
    moved = np.subtract(after, before)
    assert moved[3] == 0
    assert moved[:3].min() > 300
    assert rover.axes[3].speed_rad_s == 0.0
    assert rover.true_speeds[3] > 6.0
    rover.begin("clear")
    rover.run(1500)
    rover.simulation.truth()
    assert rover.true_speeds == pytest.approx([3.0] * 4, abs=0.01)


def test_a_reversed_encoder_makes_its_wheel_run_away_and_a_frozen_feedback_none(
    rover: Rover,
) -> None:
    rover.drive((3.0, 3.0, 3.0, 3.0))
    rover.begin("feedback_frozen")
    counts = [encoder.count for encoder in rover.encoders]
    rover.run(500)
    rover.simulation.truth()
    assert [encoder.count for encoder in rover.encoders] == counts
    assert [axis.speed_rad_s for axis in rover.axes] == pytest.approx([3.0] * 4, abs=0.01)
    assert rover.true_speeds == pytest.approx([3.0] * 4, abs=0.01)
    rover.begin("encoder_reversed wheel=front_left duration=0.3")
    rover.run(250)
    rover.simulation.truth()
    assert rover.true_speeds[0] > 6.0


def test_exchanged_encoders_count_the_other_wheel_and_mislead_both_loops() -> None:
    rover = Rover(ROBOTS["skid_steer"])
    rover.begin("wheels_swapped wheel=front_left other=rear_right")
    rover.axes[0].command(Mode.SPEED, 3.0)
    for axis in rover.axes[1:]:
        axis.command(Mode.COAST)
    rover.plant.axes[3].block()
    rover.run(500)
    rover.simulation.truth()
    assert rover.encoders[0].count == 0, "it counts a wheel that is held"
    assert rover.encoders[3].count > 500
    assert rover.true_speeds[0] > 6.0


@pytest.mark.parametrize("name", ["front_left", "rear_right"])
def test_a_wheel_on_oil_drives_and_holds_no_longer(name: str) -> None:
    # One driven wheel: without its grip the robot stays where it is.
    moved = []
    for line in ("", f"wheel_slipping wheel={name} grip=0.01"):
        rover = Rover(ROBOTS["skid_steer"])
        if line:
            rover.begin(line)
        number = rover.simulation.config.drive.wheel_names.index(name)
        rover.axes[number].command(Mode.SPEED, 5.0)
        rover.run(1000)
        rover.simulation.truth()
        moved.append(math.hypot(rover.plant.x_m - 2.0, rover.plant.y_m - 2.0))
        rover.begin("clear")
    grips, slips = moved
    assert slips < 0.2 * grips


def test_a_wheel_that_slipped_grips_again() -> None:
    first, second = Rover(ROBOTS["skid_steer"]), Rover(ROBOTS["skid_steer"])
    second.begin("wheel_slipping wheel=front_left grip=0.5")
    second.begin("wheel_slipping wheel=front_left grip=0.0 duration=0.001")
    second.run(10)
    second.begin("clear")
    first.run(10)
    for rover in (first, second):
        rover.drive((2.0, 5.0, 2.0, 5.0))
    assert first.plant.motion == second.plant.motion


def test_more_current_and_heat_appear_at_their_motor_alone(rover: Rover) -> None:
    rover.drive((3.0, 3.0, 3.0, 3.0))
    currents = [axis.current_a for axis in rover.axes]
    heats = [axis.temperature_c for axis in rover.axes]
    rover.begin("over_current wheel=rear_left amperes=5")
    rover.begin("over_temperature wheel=front_right kelvin=40")
    added = np.subtract([axis.current_a for axis in rover.axes], currents)
    warmed = np.subtract([axis.temperature_c for axis in rover.axes], heats)
    assert added == pytest.approx([0.0, 0.0, 5.0, 0.0])
    assert warmed == pytest.approx([0.0, 40.0, 0.0, 0.0])


def test_less_supply_bounds_the_speed_that_a_loop_reaches(rover: Rover) -> None:
    spin = (-100.0, 100.0, -100.0, 100.0)
    rover.drive(spin, 2000)
    full = rover.true_speeds[1]
    rover.begin("under_voltage volts=5")
    rover.drive(spin, 2000)
    left_v = rover.simulation.faults.stage.bus_voltage_v
    assert left_v < 8.0
    assert rover.plant.axes[1].voltage_v == pytest.approx(left_v, rel=0.01)
    assert rover.true_speeds[1] < 0.65 * full
    rover.begin("clear")
    rover.drive(spin, 2000)
    assert rover.true_speeds[1] == pytest.approx(full, rel=0.01)


def test_a_robot_that_glides_sideways_too_fast_is_found_out() -> None:
    config = mecanum({"limits.v_max_m_s": 0.3})
    rover = Rover(config)
    rover.drive(STRAFE)
    for axis in rover.axes:
        axis.command(Mode.COAST)
    rover.plant._b["vy"] = 0.45
    rover.run(10)
    found = rover.simulation.monitor.findings[-1]
    assert found.kind is Kind.SPEED
    assert found.reason.endswith("m/s to the left, allowed 0.3")


@pytest.mark.parametrize("config", ROBOTS.values(), ids=ROBOTS)
def test_after_any_mixture_of_faults_the_robot_is_as_sound_as_before(config: RobotConfig) -> None:
    rover, rng = Rover(config), np.random.default_rng(5)
    felt = [
        (name, kind)
        for name, kind in CATALOGUE.items()
        if not any(kind.fits(config, kind.complete({}))) and "host" not in name and name != "no_ack"
    ]
    assert {"wheel_blocked", "encoder_stuck", "wheels_swapped", "brown_out"} <= {n for n, _ in felt}
    speeds = tuple([2.0] * len(rover.axes))
    for _ in range(60):
        name, kind = felt[rng.integers(len(felt))]
        line = name + (" duration=0.05" if "duration" in kind.parameters else "")
        if "wheel" in kind.parameters and name != "wheels_swapped":
            line += f" wheel={rng.choice(config.drive.wheel_names)}"
        rover.begin(line)
        rover.drive(speeds, 20)
    rover.begin("clear")
    rover.simulation.plant.place(2.0, 2.0, 0.0)
    rover.drive(speeds, 1000)
    before = [encoder.count for encoder in rover.encoders]
    angles = [axis.angle_rad for axis in rover.plant.axes]
    rover.drive(speeds, 500)
    turned = np.subtract([axis.angle_rad for axis in rover.plant.axes], angles)
    counted = np.subtract([encoder.count for encoder in rover.encoders], before)
    assert turned == pytest.approx([1.0] * len(speeds), abs=0.01)
    assert counted == pytest.approx(turned * 4096 / math.tau, abs=1.0)
