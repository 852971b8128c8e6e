"""Parameters of the physics: frozen values, validated when a robot's TOML is read.

Units stand in the names. All lengths are in the base frame (x forward, y left) of the robot; the
base of a drive-and-steer robot is the centre of its rear axle. The defaults are those of a small
12 V robot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from firmware_sim.config.camera_parameters import CameraParameters
from firmware_sim.config.outline import check_outline
from firmware_sim.config.quantities import (
    NotNegative,
    Point,
    Positive,
    Rate,
    Real,
    RelativeError,
    Share,
    closed,
)

SHORTEST_HEATING_S = 0.01
"""Minimum thermal time constant [s]: heat is integrated in steps of 1 ms."""


@closed
@dataclass(frozen=True, slots=True)
class SonarMount:
    """Position and direction of a sonar on the robot, counter-clockwise from forward."""

    name: str
    x_m: Real
    y_m: Real
    heading_deg: Real

    @property
    def heading_rad(self) -> float:
        """Heading of the beam's axis in base [rad]."""
        return math.radians(self.heading_deg)


@closed
@dataclass(frozen=True, slots=True)
class ImuMount:
    """The table `[imu]`: whether there is one, where it sits, and where its x axis points.

    `yaw_deg` counts from forward to the left; `tilt_max_deg` is left to robotctl.
    """

    enabled: bool = False
    x_m: Real = 0.0
    y_m: Real = 0.0
    yaw_deg: Real = 0.0
    tilt_max_deg: Real = 20.0


@closed
@dataclass(frozen=True, slots=True)
class MotorParameters:
    """A DC motor with gearbox. Friction and inertia are those of the motor shaft.

    `gear_efficiency` acts as friction in proportion to the motor's torque, so a gear never
    delivers energy: driving forwards the wheel gets that share of the torque.
    `inductance_h` = 0 selects the quasi-static limit. `stiction_ratio` is static over sliding
    Coulomb friction. The winding is heated by its copper loss and cools to the case, the case to
    the air; its resistance rises by 0.39 % per kelvin.

    A brushless motor under field-oriented control behaves as the DC motor whose current is the
    amplitude of its phase currents: `back_emf_v_s_rad` is its torque constant, 8.27 / KV with KV in
    rpm per volt; `resistance_ohm` and `inductance_h` are 1.5 times those of one phase, or three
    quarters of those between two leads; and `voltage_share` of the bridge is 0.866, half the root
    of three. A hub motor has a `gear_ratio` and a `gear_efficiency` of 1.
    """

    resistance_ohm: Positive = 1.5
    inductance_h: NotNegative = 1.0e-3
    back_emf_v_s_rad: Positive = 0.0225
    gear_ratio: Positive = 20.0
    gear_efficiency: Annotated[float, Field(strict=True, gt=0, le=1)] = 0.9
    rotor_inertia_kg_m2: Positive = 5.0e-6
    viscous_n_m_s_rad: NotNegative = 2.0e-6
    coulomb_n_m: NotNegative = 3.0e-3
    stiction_ratio: Annotated[float, Field(strict=True, ge=1, le=100)] = 1.2
    current_limit_a: Positive = 10.0
    winding_heat_j_k: Positive = 12.0
    case_heat_j_k: Positive = 150.0
    winding_to_case_k_w: Positive = 2.5
    case_to_air_k_w: Positive = 8.0
    air_c: Real = 25.0

    def __post_init__(self) -> None:
        outward = 1.0 / self.winding_to_case_k_w
        winding_s = self.winding_heat_j_k / outward
        case_s = self.case_heat_j_k / (outward + 1.0 / self.case_to_air_k_w)
        if min(winding_s, case_s) < SHORTEST_HEATING_S:
            raise ValueError(
                f"the winding warms within {winding_s:.2g} s, the case within {case_s:.2g} s by "
                "*_heat_j_k and *_k_w; allowed are times (heat times thermal resistance) from "
                f"{SHORTEST_HEATING_S} s on"
            )


@closed
@dataclass(frozen=True, slots=True)
class BridgeParameters:
    """The H-bridge: PWM bits, no output below the duty `deadband`, resistance of two switches.

    `voltage_share` is its greatest output as a share of the supply: 1 for an H-bridge, 0.866 for
    three phases.
    """

    resistance_ohm: NotNegative = 0.02
    pwm_bits: Annotated[int, Field(strict=True, ge=4, le=16)] = 12
    deadband: Annotated[float, Field(strict=True, ge=0, lt=0.5)] = 0.02
    voltage_share: Annotated[float, Field(strict=True, gt=0, le=1)] = 1.0


@closed
@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """Lithium-ion cells in series: open-circuit voltage over charge, resistance, one RC pair.

    `charge` is the state at power-on (1 full). `voltage_scale` multiplies the open-circuit voltage:
    a simple test with 70 % of the voltage. `electronics_current_a` always flows. No more than
    `charge_current_max_a` flows back into it (0: a mains supply): the rest of the motors' feedback
    raises the voltage of the rail, which has capacitors of `rail_capacitance_f`.
    """

    cells: Annotated[int, Field(strict=True, gt=0, le=1000)] = 3
    capacity_ah: Positive = 5.0
    internal_resistance_ohm: NotNegative = 0.06
    polarisation_resistance_ohm: NotNegative = 0.03
    polarisation_time_s: Positive = 20.0
    charge: Share = 1.0
    voltage_scale: Positive = 1.0
    electronics_current_a: NotNegative = 0.5
    charge_current_max_a: NotNegative = 1.0e6
    rail_capacitance_f: Positive = 2.0e-3


@closed
@dataclass(frozen=True, slots=True)
class WheelParameters:
    """Contact of tyre and floor.

    Force grows in proportion to the slip velocity, up to `friction` times the load, which it
    reaches at `slip_speed_m_s` + `slip_ratio` · |speed|. `floor_noise` is the standard deviation
    of the relative change of the rolling radius from bumps and dust, correlated over
    `floor_length_m`; on it dead reckoning drifts with a variance of
    2 · floor_noise² · floor_length_m per metre of each wheel. `inertia_kg_m2` is that of one
    driven wheel. The rollers of mecanum and omni wheels drag with `roller_drag` times the load.
    """

    inertia_kg_m2: NotNegative = 2.0e-4
    friction: Positive = 0.8
    slip_ratio: NotNegative = 0.03
    slip_speed_m_s: Positive = 0.002
    rolling_resistance: NotNegative = 0.01
    floor_noise: NotNegative = 0.002
    floor_length_m: Positive = 0.05
    roller_drag: NotNegative = 0.02


@closed
@dataclass(frozen=True, slots=True)
class CastorParameters:
    """The castor of a differential drive: it carries the rest of the weight, and drags a little."""

    position_m: Point = (-0.12, 0.0)
    drag: NotNegative = 0.01


@closed
@dataclass(frozen=True, slots=True)
class SteeringParameters:
    """The steering servo: first-order lag, its rate limited by the drive's."""

    time_constant_s: NotNegative = 0.03


@closed
@dataclass(frozen=True, slots=True)
class GeometryErrors:
    """How the true robot differs from its configuration: relative, 0 for a calibrated one.

    `wheel_radius` has one entry for each driven wheel, or none. `wheel_distance` is that of omni
    wheels from base.
    """

    wheel_radius: tuple[RelativeError, ...] = ()
    track_width: RelativeError = 0.0
    wheelbase: RelativeError = 0.0
    wheel_distance: RelativeError = 0.0
    steering_offset_rad: Annotated[float, Field(strict=True, gt=-0.5, lt=0.5)] = 0.0


@closed
@dataclass(frozen=True, slots=True)
class SonarParameters:
    """The ultrasonic sensors of the ring, all identical, `z_m` above the floor.

    The cone of `beam_deg` (full angle) is a fan of `rays`; a ray that meets a surface at more than
    `max_incidence_deg` from its normal is lost, except in concave corners, which reflect back.
    Noise has the standard deviation `sigma_m` + `sigma_per_m` · range. Nearer than `min_range_m`
    the sensor reports `min_range_m`, farther than `max_range_m` nothing.
    """

    z_m: Positive = 0.1
    beam_deg: Annotated[float, Field(strict=True, gt=0, le=120)] = 25.0
    rays: Annotated[int, Field(strict=True, ge=3, le=101)] = 15
    max_incidence_deg: Annotated[float, Field(strict=True, gt=0, le=90)] = 35.0
    min_range_m: NotNegative = 0.03
    max_range_m: Annotated[float, Field(strict=True, gt=0, le=8.0)] = 4.0
    sigma_m: NotNegative = 0.003
    sigma_per_m: NotNegative = 0.004
    outlier_probability: Share = 0.005
    dropout_probability: Share = 0.005
    crosstalk_probability: Share = 0.05
    corner_echo: bool = True

    def __post_init__(self) -> None:
        _check_ranges(self.min_range_m, self.max_range_m)


@closed
@dataclass(frozen=True, slots=True)
class LidarParameters:
    """A planar lidar: `beams` over `fov_deg`, the first at the right, in scans of `rate_hz`.

    `sweep_s` is the time from its first beam to its last, negative if it turns clockwise and
    measures the last one first; 0: all at one instant. `name` tells several apart.
    """

    name: str = ""
    x_m: Real = 0.0
    y_m: Real = 0.0
    z_m: Positive = 0.2
    heading_deg: Real = 0.0
    beams: Annotated[int, Field(strict=True, ge=2, le=10_000)] = 360
    fov_deg: Annotated[float, Field(strict=True, gt=0, le=360)] = 360.0
    rate_hz: Rate = 10.0
    sweep_s: Real = 0.0
    min_range_m: NotNegative = 0.05
    max_range_m: Positive = 12.0
    sigma_m: NotNegative = 0.01
    dropout_probability: Share = 0.002

    def __post_init__(self) -> None:
        if abs(self.sweep_s) * self.rate_hz > 1.0 + 1e-9:
            raise ValueError(
                f"sweep_s: {self.sweep_s} is longer than a turn at rate_hz = {self.rate_hz:g}"
            )
        _check_ranges(self.min_range_m, self.max_range_m)


def _table_or_tables(value: object) -> str:
    return "tables" if isinstance(value, list | tuple) else "table"


Lidars = Annotated[
    Annotated[LidarParameters, Tag("table")]
    | Annotated[tuple[LidarParameters, ...], Tag("tables")],
    Discriminator(_table_or_tables),
]
"""One lidar, `[simulation.lidar]`, or several, `[[simulation.lidar]]` each."""


@closed
@dataclass(frozen=True, slots=True)
class ImuParameters:
    """The inertial measurement unit.

    `gyro_bias_rad_s` and `force_bias_m_s2` are standard deviations, from which the seed draws the
    constant bias of each axis; the sigmas are those of a sample. The floor shakes it by
    `vibration_m_s2_per_m_s` times the speed.
    """

    gyro_sigma_rad_s: NotNegative = 0.002
    gyro_bias_rad_s: NotNegative = 0.01
    force_sigma_m_s2: NotNegative = 0.03
    force_bias_m_s2: NotNegative = 0.05
    vibration_m_s2_per_m_s: NotNegative = 0.5


def _check_ranges(min_range_m: float, max_range_m: float) -> None:
    if min_range_m >= max_range_m:
        raise ValueError(f"min_range_m: {min_range_m} is not less than max_range_m, {max_range_m}")


@closed
@dataclass(frozen=True, slots=True)
class SimulationParameters:
    """The table `[simulation]`. `centre_of_mass_m` and `body` are in base.

    `body` is the true outline; without one, it is that of the table `[body]`, whose parts count
    in any case.

    The CAN controllers of `classic_nodes` are classic: they destroy frames of CAN FD for all nodes.
    `twin` has a table of true values for each motor drive, by its name.
    """

    mass_kg: Positive
    yaw_inertia_kg_m2: Positive
    body: tuple[Point, ...] | None = None
    centre_of_mass_m: Point = (-0.015, 0.0)
    wall_friction: NotNegative = 0.3
    classic_nodes: tuple[str, ...] = ()
    motor: MotorParameters = field(default_factory=MotorParameters)
    bridge: BridgeParameters = field(default_factory=BridgeParameters)
    battery: BatteryParameters = field(default_factory=BatteryParameters)
    wheels: WheelParameters = field(default_factory=WheelParameters)
    castor: CastorParameters = field(default_factory=CastorParameters)
    steering: SteeringParameters = field(default_factory=SteeringParameters)
    errors: GeometryErrors = field(default_factory=GeometryErrors)
    sonar: SonarParameters = field(default_factory=SonarParameters)
    lidar: Lidars | None = None
    camera: CameraParameters = field(default_factory=CameraParameters)
    imu: ImuParameters = field(default_factory=ImuParameters)
    twin: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def lidars(self) -> tuple[LidarParameters, ...]:
        """All lidars, in the order of the file."""
        if self.lidar is None:
            return ()
        return self.lidar if isinstance(self.lidar, tuple) else (self.lidar,)

    def __post_init__(self) -> None:
        names = [each.name for each in self.lidars]
        if len(set(names)) < len(names):
            raise ValueError(f"lidar: each needs a name of its own, found {', '.join(names)}")
        if self.body is not None:
            check_outline("body", self.body)
