"""The robot's body, motors and battery in the room.

The state is the truth: nothing here is measured but the encoder counts, which are whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import IntEnum

import numpy as np

from firmware_sim.compiled import noise_state
from firmware_sim.config.config import RobotConfig
from firmware_sim.errors import SimulationError
from firmware_sim.plant.battery import open_circuit_voltage
from firmware_sim.plant.contact import COLUMNS, ROWS
from firmware_sim.plant.discs import nearest_point
from firmware_sim.plant.plant_state import BODY, DIFFERENTIAL, DT_S, WHEEL, constants, nominal_radii
from firmware_sim.plant.plant_step import run_plant
from firmware_sim.plant.walls import body_outline, wall_grid
from firmware_sim.world.world import World

STEP_NS = round(DT_S * 1e9)
"""Length of one step of the plant [ns]."""
_PLACES_TRIED = 3000


def _places(record: np.dtype, *names: str) -> Iterator[int]:
    """Yield where in a record its fields stand."""
    return map(list(record.names or ()).index, names)


_X, _Y, _THETA, _VX, _VY, _OMEGA, _STEERING, _STEERING_CMD, _BRIDGE = _places(
    BODY, "x", "y", "theta", "vx", "vy", "omega", "steering", "steering_cmd", "bridge"
)
_BUS_V, _BATTERY_A, _CHARGE, _DISTANCE = _places(BODY, "bus_v", "battery_a", "charge", "distance")
_DUTY, _WHEEL_OMEGA, _ANGLE, _CURRENT, _WINDING_C = _places(
    WHEEL, "duty", "omega", "angle", "current", "winding_c"
)


class Bridge(IntEnum):
    """States of the bridges: drive by duty, freewheel, short the windings."""

    DRIVE = 0
    COAST = 1
    BRAKE = 2


_DRIVE = float(Bridge.DRIVE)


class Plant:
    """A robot in a room, advanced in steps of 1 ms.

    Starts at rest at the world's start pose with the bridges open. Channel 1 is the left wheel of a
    differential drive, or the only motor of a drive-and-steer robot, whose channel 2 is dead.

    Parameters
    ----------
    config
        The robot.
    world
        The room.
    rng
        Seeds the roughness of the floor. The same seed and commands give the same motion, bit for
        bit, on the same machine.

    Attributes
    ----------
    discs
        Middles in world and radii, (n, 3) [m], of what else stands in the way; they may move.

    Raises
    ------
    SimulationError
        The robot cannot stand where it should start, or not on its wheels at all.
    """

    def __init__(self, config: RobotConfig, world: World, rng: np.random.Generator) -> None:
        try:
            self._p = constants(config)
        except ValueError as error:
            raise SimulationError(f"{config.robot.name}: simulation.{error}") from error
        self._pwm_steps = 2**config.simulation.bridge.pwm_bits
        self._deadband = config.simulation.bridge.deadband
        self._per_rad = config.drive.counts_per_revolution / (2.0 * math.pi)
        self._motors = int(self._p["wheels"][0])
        self._world = world
        self._segments = world.touchable
        self._outline = body_outline(config.simulation.body)
        self._origin, self._grid = wall_grid(self._segments, float(self._p["reach"][0]))
        self._rows = np.zeros((ROWS, COLUMNS))
        self._noise = noise_state(rng)
        self.discs = np.empty((0, 3))
        self._body = np.zeros(1, BODY)
        self._wheels = np.zeros(2, WHEEL)
        self._b = self._body[0]
        self._w = (self._wheels[0], self._wheels[1])
        # Hot-path access goes through these, at a fifth of a record's cost.
        self._body_numbers = _numbers(self._body)
        self._wheel_numbers = (_numbers(self._wheels[:1]), _numbers(self._wheels[1:]))
        self._steering_max_rad = float(self._p["steering_max"][0])
        self._com_x_m = float(self._p["com_x"][0])
        self._com_y_m = float(self._p["com_y"][0])
        self._start(config)
        self._begin_at(*world.start)

    def _start(self, config: RobotConfig) -> None:
        """Set the values that are not zero at power-on."""
        s = config.simulation
        loads = (self._p["load0"][0], self._p["load1"][0])
        radii = nominal_radii(config.drive)
        for wheel, radius, error, load in zip(
            self._w, radii, s.errors.wheel_radius, loads, strict=True
        ):
            wheel["radius"] = radius * (1.0 + error)
            wheel["rolling"] = s.wheels.rolling_resistance * load * wheel["radius"]
            wheel["winding_c"] = wheel["case_c"] = s.motor.air_c
        self._b["bridge"] = Bridge.COAST
        self._b["charge"] = s.battery.charge
        self._b["battery_a"] = s.battery.electronics_current_a
        source = float(self._p["cells_scale"][0]) * open_circuit_voltage(s.battery.charge)
        self._b["bus_v"] = source - s.battery.internal_resistance_ohm * self.battery_current_a

    def warm(self) -> None:
        """Compile, or load from the cache, what `step` needs; changes nothing."""
        self.step(0)

    def command(
        self, duty1: float, duty2: float, steering_rad: float = 0.0, bridge: Bridge = Bridge.DRIVE
    ) -> None:
        """Set what the bridges and the steering servo do from now on.

        Parameters
        ----------
        duty1, duty2
            Share of the rail's voltage in [-1, 1], positive forwards; the bridge rounds it to its
            PWM steps and gives nothing within its dead-band. Without effect unless driving.
        steering_rad
            Demanded angle, positive left; limited to what the linkage allows.
        bridge
            State of the bridges.

        Raises
        ------
        ValueError
            A duty is not in [-1, 1], or the angle not finite.
        """
        if not (-1.0 <= duty1 <= 1.0 and -1.0 <= duty2 <= 1.0 and math.isfinite(steering_rad)):
            raise ValueError(
                f"command: duties {duty1}, {duty2} not in [-1, 1], or steering {steering_rad}"
            )
        body, limit = self._body_numbers, self._steering_max_rad
        body[_BRIDGE] = float(bridge)
        self._wheel_numbers[0][_DUTY] = self._output(duty1)
        self._wheel_numbers[1][_DUTY] = self._output(duty2)
        body[_STEERING_CMD] = min(max(steering_rad, -limit), limit)

    def _output(self, duty: float) -> float:
        """Mean output of a bridge for a duty: rounded to PWM steps, the dead-band taken off."""
        top = self._pwm_steps
        size = round(abs(duty) * top) / top - self._deadband
        if size <= 0.0:
            return 0.0
        return math.copysign(size / (1.0 - self._deadband), duty)

    def step(self, n: int = 1) -> None:
        """Advance by n milliseconds."""
        run_plant(
            n,
            self._body,
            self._wheels,
            self._p,
            self._outline,
            self._segments,
            self._origin,
            self._grid,
            self._rows,
            self._noise,
            self.discs,
        )

    def _begin_at(self, x_m: float, y_m: float, theta_rad: float) -> None:
        """Put the robot at its start; raises SimulationError, with the nearest place for it."""
        low_x, low_y, high_x, high_y = self._world.bounds
        try:
            if not (low_x <= x_m <= high_x and low_y <= y_m <= high_y):
                raise SimulationError(
                    f"the start at x {x_m} m, y {y_m} m lies outside {self._world.name}: allowed "
                    f"are x {low_x:g}..{high_x:g} m, y {low_y:g}..{high_y:g} m"
                )
            self.place(x_m, y_m, theta_rad)
        except SimulationError as error:
            raise SimulationError(f"{error}; {self._nearest_place(x_m, y_m, theta_rad)}") from error

    def place(self, x_m: float, y_m: float, theta_rad: float) -> None:
        """Move the robot, at rest; counts and distance continue.

        Raises
        ------
        SimulationError
            A wall is in the way.
        """
        if obstacle := self._obstacle(x_m, y_m, theta_rad):
            raise SimulationError(
                f"the robot cannot stand at x {x_m} m, y {y_m} m, heading {theta_rad} rad: "
                f"{obstacle} is in the way"
            )
        b = self._b
        b["x"], b["y"], b["theta"] = x_m, y_m, theta_rad
        b["vx"] = b["vy"] = b["omega"] = b["touch_s"] = b["contacts"] = 0.0
        for wheel in self._w:
            wheel["omega"] = 0.0

    def _obstacle(self, x_m: float, y_m: float, theta_rad: float) -> str:
        """Name of the obstacle to placing the robot somewhere; "" if none."""
        if inside := self._world.solid_at(x_m, y_m):
            return inside
        touches = _overlaps(self._outline, self._segments, x_m, y_m, theta_rad)
        return "a wall" if touches else ""

    def _nearest_place(self, x_m: float, y_m: float, theta_rad: float) -> str:
        """Say where the robot can stand, with the same heading."""
        for place in self._world.places(x_m, y_m)[:_PLACES_TRIED].tolist():
            x, y = (round(each, 2) for each in place)
            if not self._obstacle(x, y, theta_rad):
                return f"the nearest place for it with this heading is x {x} m, y {y} m"
        return "there is no place for it near by either"

    def contact(
        self, place: np.ndarray, radius_m: float, motion: tuple[float, float, float]
    ) -> tuple[float, float]:
        """Return the gap to a disc [m], and how fast the outline there moves towards it [m/s].

        `motion` is forward and lateral speed of base [m/s] and yaw rate [rad/s].
        """
        body = self._body_numbers
        cos, sin = math.cos(body[_THETA]), math.sin(body[_THETA])
        off_x, off_y = float(place[0]) - body[_X], float(place[1]) - body[_Y]
        x, y = cos * off_x + sin * off_y, -sin * off_x + cos * off_y
        distance, near_x, near_y = nearest_point(x, y, self._outline)
        v, lateral, omega = motion
        towards = (v - omega * near_y) * (x - near_x) + (lateral + omega * near_x) * (y - near_y)
        return distance - radius_m, towards / distance if distance != 0.0 else 0.0

    @property
    def motion(self) -> tuple[float, float, float]:
        """Forward and lateral speed of base [m/s] and yaw rate [rad/s]."""
        return self.v_m_s, self.lateral_m_s, self.omega_rad_s

    def block(self, channel: int, blocked: bool = True) -> None:
        """Hold the wheel of channel 1 or 2, or let it go: a fault, under which the motor stalls."""
        self._w[channel - 1]["blocked"] = float(blocked)

    @property
    def powered(self) -> bool:
        """Whether a bridge drives its motor: the only source of torque but braking."""
        if self._body_numbers[_BRIDGE] != _DRIVE:
            return False
        one, other = self._wheel_numbers
        return one[_DUTY] != 0.0 or other[_DUTY] != 0.0

    def _count(self, k: int) -> int:
        if k >= self._motors:
            return 0
        return math.floor(self._wheel_numbers[k][_ANGLE] * self._per_rad)

    @property
    def count1(self) -> int:
        """Quadrature counts of channel 1 since power-on, unbounded."""
        return self._count(0)

    @property
    def count2(self) -> int:
        """Quadrature counts of channel 2 since power-on, unbounded; 0 if there is none."""
        return self._count(1)

    @property
    def current1_a(self) -> float:
        """Current of motor 1 [A], positive with forward torque."""
        return self._wheel_numbers[0][_CURRENT]

    @property
    def current2_a(self) -> float:
        """Current of motor 2 [A], positive with forward torque; 0 if there is none."""
        return self._wheel_numbers[1][_CURRENT]

    @property
    def temperature1_c(self) -> float:
        """Winding temperature of motor 1 [°C]."""
        return self._wheel_numbers[0][_WINDING_C]

    @property
    def temperature2_c(self) -> float:
        """Winding temperature of motor 2 [°C]."""
        return self._wheel_numbers[1][_WINDING_C]

    @property
    def omega1_rad_s(self) -> float:
        """True speed of wheel 1 [rad/s]."""
        return self._wheel_numbers[0][_WHEEL_OMEGA]

    @property
    def omega2_rad_s(self) -> float:
        """True speed of wheel 2 [rad/s]; 0 if there is none."""
        return self._wheel_numbers[1][_WHEEL_OMEGA]

    @property
    def bus_voltage_v(self) -> float:
        """Voltage of the rail that feeds all bridges [V]."""
        return self._body_numbers[_BUS_V]

    @property
    def battery_current_a(self) -> float:
        """Current out of the battery [A]; negative charges."""
        return self._body_numbers[_BATTERY_A]

    @property
    def charge(self) -> float:
        """State of charge in [0, 1]."""
        return self._body_numbers[_CHARGE]

    @charge.setter
    def charge(self, value: float) -> None:
        self._b["charge"] = min(max(value, 0.0), 1.0)

    @property
    def steering_rad(self) -> float:
        """Angle of the steering servo, or of a car's virtual centre wheel [rad], positive left."""
        return self._body_numbers[_STEERING]

    @property
    def x_m(self) -> float:
        """True x of base in world [m]."""
        return self._body_numbers[_X]

    @property
    def y_m(self) -> float:
        """True y of base in world [m]."""
        return self._body_numbers[_Y]

    @property
    def theta_rad(self) -> float:
        """True heading [rad], in (-π, π]."""
        return -math.remainder(-self._body_numbers[_THETA], 2.0 * math.pi)

    @property
    def v_m_s(self) -> float:
        """True forward speed of base [m/s]."""
        body = self._body_numbers
        return body[_VX] + body[_OMEGA] * self._com_y_m

    @property
    def lateral_m_s(self) -> float:
        """True sideways speed of base [m/s]: tyres slipping."""
        body = self._body_numbers
        return body[_VY] - body[_OMEGA] * self._com_x_m

    @property
    def omega_rad_s(self) -> float:
        """True yaw rate [rad/s]."""
        return self._body_numbers[_OMEGA]

    @property
    def collisions(self) -> int:
        """Collisions since power-on; contacts that follow within 0.3 s are one."""
        return int(self._b["collisions"])

    @property
    def touching(self) -> bool:
        """Whether a wall is touched, or was within the last 0.3 s."""
        return float(self._b["touch_s"]) > 0.0

    @property
    def impact_m_s(self) -> float:
        """Speed towards the wall at the beginning of the last collision [m/s]."""
        return float(self._b["impact_m_s"])

    @property
    def distance_m(self) -> float:
        """Length of the base's path since power-on [m]."""
        return self._body_numbers[_DISTANCE]

    @property
    def rear_wheels_rad_s(self) -> tuple[float, float]:
        """Speeds of the left and right wheel of the base's axle [rad/s], if they roll freely."""
        if int(self._p["kind"][0]) == DIFFERENTIAL:
            return self.omega1_rad_s, self.omega2_rad_s
        half, radius = float(self._p["half_track"][0]), float(self._w[0]["radius"])
        turn = self.omega_rad_s * half
        return (self.v_m_s - turn) / radius, (self.v_m_s + turn) / radius


def _numbers(record: np.ndarray) -> memoryview[float]:
    """Return the numbers of one record in their order, writable."""
    return record.data.cast("B").cast("d")


def _overlaps(outline: np.ndarray, segments: np.ndarray, x: float, y: float, theta: float) -> bool:
    """Whether the outline at a pose touches a wall: separating axes of convex shapes."""
    if len(segments) == 0:
        return False
    c, s = math.cos(theta), math.sin(theta)
    relative = segments - np.array([x, y, x, y])
    ends = np.stack(
        [
            np.stack([c * relative[:, i] + s * relative[:, i + 1] for i in (0, 2)], axis=1),
            np.stack([-s * relative[:, i] + c * relative[:, i + 1] for i in (0, 2)], axis=1),
        ],
        axis=2,
    )
    apart = np.zeros(len(segments), dtype=bool)
    for vx, vy, nx, ny, _ in outline:
        gap = (ends[:, :, 0] - vx) * nx + (ends[:, :, 1] - vy) * ny
        apart |= np.min(gap, axis=1) > 0.0
    side = ends[:, 1] - ends[:, 0]
    normal = np.stack([-side[:, 1], side[:, 0]], axis=1)
    across = (outline[None, :, :2] - ends[:, None, 0]) @ normal[:, :, None]
    apart |= (np.min(across[:, :, 0], axis=1) > 0.0) | (np.max(across[:, :, 0], axis=1) < 0.0)
    return bool(np.any(~apart))
