"""The simulated robot as one object: buses, nodes, plant and sensors under one virtual time.

Time passes only in `advance`, on all buses from event to event. Nodes receive frames at the exact
bit time, and are woken by the bus's timers at the nanosecond they set; nothing is polled. The plant
lags, in whole steps of 1 ms, and is brought up to date only on access: by a command, a SYNC, a
sonar, a guard, or a read of the truth.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from firmware_sim.bus import fd_bits
from firmware_sim.bus.core import Bus
from firmware_sim.bus.faults import FaultPlan
from firmware_sim.bus.frame import Frame
from firmware_sim.bus.port import Port
from firmware_sim.bus.state import FdSupport
from firmware_sim.config.config import RobotConfig, load_robot
from firmware_sim.config.motors import OWN_KIND, motor_table
from firmware_sim.config.parameters import LidarParameters
from firmware_sim.drives.registry import true_drive
from firmware_sim.drives.twin import Motor, Twin
from firmware_sim.errors import SimulationError, nearest
from firmware_sim.faults.faults import Faults
from firmware_sim.faults.faulty_imu import FaultyImu
from firmware_sim.faults.faulty_parts import FaultyRing, FaultyStage
from firmware_sim.faults.faulty_robot import FaultyRobot
from firmware_sim.faults.monitor import FORBIDS, TIMEOUT_MARGIN_NS, Allowed, Motion, SafetyMonitor
from firmware_sim.faults.monitor import PERIOD_NS as MONITOR_PERIOD_NS
from firmware_sim.nodes.drive import DriveNode
from firmware_sim.nodes.drive_guards import MotorModel
from firmware_sim.nodes.imu import ImuNode, ImuSample
from firmware_sim.nodes.kinds import NODE_NAMES
from firmware_sim.nodes.node import Node
from firmware_sim.nodes.parameter_store import (
    FileStore,
    FragileStore,
    MemoryStore,
    ParameterStore,
)
from firmware_sim.nodes.power import BatterySample, PowerNode
from firmware_sim.nodes.power_stage import MotorAxis
from firmware_sim.nodes.sonar import Ranges, SonarNode
from firmware_sim.plant.axis import Mode
from firmware_sim.plant.body_disc import BodyDisc
from firmware_sim.plant.plant import STEP_NS, Plant
from firmware_sim.sensors.imu import BodyMotion, Imu
from firmware_sim.sensors.lidar import Lidar
from firmware_sim.sensors.sonar import SonarRing
from firmware_sim.world.manner import STUBBORN, Manner
from firmware_sim.world.people import People
from firmware_sim.world.truth import Picture, Scan, Truth
from firmware_sim.world.walking.walker import STEP_NS as PEOPLE_STEP_NS
from firmware_sim.world.walking.walker import Mover
from firmware_sim.world.world import World, load_world

if TYPE_CHECKING:
    from firmware_sim.camera.camera import Camera

Memory: TypeAlias = Callable[[str], ParameterStore]
"""Function that returns the non-volatile memory of a node by its name."""

CONTINUOUS_SHARE = 0.7
"""Default limit of the drive's over-current guard, as a share of the maximum current."""
CELL_V = 3.7
_STREAMS = 7
"""Random streams of a robot with one bus; each further bus adds one."""
CURRENT_STEP_MA = 500


class Simulation:
    """A robot on its CAN buses in a room.

    Attach a host with `simulation.bus.attach`, then let time pass with `advance`. The nodes boot
    in the first 8 ms. A robot with several buses has `simulation.buses` by name, of which `bus` is
    the first.

    Parameters
    ----------
    robot
        Robot or its TOML file.
    world
        Room or its TOML file.
    seed
        Seed of all random draws; bus faults, floor, sonar, lidar, broken sensors, IMU and camera
        each have a stream of their own. The same seed and commands give the same frames at the same
        nanoseconds.
    start
        Pose of base in world: x [m], y [m], heading [rad]; None: the world's.
    state_directory
        Directory of stored parameters; None: they are kept in memory.
    faults
        Faults of the first bus.
    start_ns
        Time at which the simulation starts [ns].
    people
        Number of people in addition to the world's.
    manners
        Manners in which these walk, in turn.

    Raises
    ------
    SimulationError
        If a file is invalid or the robot cannot stand at `start`.
    """

    def __init__(
        self,
        robot: RobotConfig | Path,
        world: World | Path,
        seed: int = 0,
        start: tuple[float, float, float] | None = None,
        *,
        state_directory: Path | None = None,
        faults: FaultPlan | None = None,
        start_ns: int = 0,
        people: int = 0,
        manners: tuple[Manner, ...] = STUBBORN,
    ) -> None:
        config = load_robot(robot) if isinstance(robot, Path) else robot
        _check_names(config)
        room = load_world(world) if isinstance(world, Path) else world
        if start is not None:
            room = dataclasses.replace(room, start=start)
        seeds = np.random.SeedSequence(seed).spawn(_STREAMS + len(config.buses) - 1)
        streams = [np.random.default_rng(each) for each in seeds]
        self.config = config
        self.world = room
        self.buses = {
            each.name: Bus(
                each.bitrate,
                stream,
                faults=faults if each is config.buses[0] else None,
                start_ns=start_ns,
                data_bitrate=each.data_bitrate,
            )
            for each, stream in zip(config.buses, (streams[0], *streams[_STREAMS:]), strict=True)
        }
        self.bus = self.buses[config.buses[0].name]
        self.plant = Plant(config, room, streams[1])
        self._plant_ns = start_ns
        sonar_m = config.simulation.sonar.z_m
        self._ring = SonarRing(config, room.seen_from(sonar_m), streams[2])
        self._stage = FaultyStage(self.plant)
        self._faulty_ring = FaultyRing(self._ring, config.sonar)
        self._seed = seed
        self._camera: Camera | None = None
        self._pictures = 0
        lidars = config.simulation.lidars
        self._lidars = _lidars(lidars, room, streams[3])
        self._path = deque[tuple[int, float, float, float]]()
        """Times and poses of the last moments, if a lidar sweeps."""
        self._path_ns = max((round(1e9 * abs(each.sweep_s)) for each in lidars), default=0)
        walks = people or room.people
        self._people = People(room, people, streams[6], manners) if walks else None
        self._discs = [
            BodyDisc.around([corner for piece in pieces for corner in piece])
            for pieces in config.bodies
        ]
        """The robot as people see it, for each state of its body."""
        self._people_ns, self._motion_before = start_ns, self.plant.motion
        memory = _memory(state_directory)
        self.stores: dict[str, FragileStore] = {}
        self._axes: dict[str, list[MotorAxis]] = {}
        """Axes of each drive, by its name, in the order of its axes."""
        self.drive = self._make_drive(memory)
        self.twins = self._make_twins(memory)
        self.sonar = SonarNode(
            len(config.sonar),
            config.simulation.sonar.max_range_m,
            self._fire,
            self._store("sonar", memory),
        )
        self.power = (
            PowerNode(
                self._measure_battery,
                config.simulation.battery.cells,
                self._store("power", memory),
            )
            if config.power.source == "node"
            else None
        )
        self._imu = FaultyImu(Imu(config.simulation.imu, config.imu, streams[5]))
        self.imu = (
            ImuNode(self._measure_motion, self._store("imu", memory))
            if config.imu.enabled
            else None
        )
        self.faults = Faults(
            FaultyRobot(
                config=config,
                world=room,
                bus=self.bus,
                buses=tuple(self.buses.values()),
                bus_of=self.bus_of,
                plant=self.plant,
                nodes=self.nodes,
                twins=self.twins,
                stores=self.stores,
                stage=self._stage,
                ring=self._faulty_ring,
                imu=self._imu,
                rng=streams[4],
                run_to=self.run_to,
                supervise=self.supervise,
                power_cycle=self.power_cycle,
            )
        )
        self.monitor = SafetyMonitor(self._motion, _allowed(config))
        if self.drive is not None:
            self.bus_of("drive").tap(self.monitor.on_bus, accept=FORBIDS)
        self._ports: dict[str, Port] = {}
        self._supplied: set[str] = set()
        for node in self._devices:
            self.power_up(node)
        self._watch()

    @property
    def nodes(self) -> tuple[Node, ...]:
        """Nodes of `firmware_sim.nodes.kinds.NODES` that the robot has, in that order."""
        has_sonars = self.config.sonar or self.drive is not None
        nodes = self.drive, self.sonar if has_sonars else None, self.power, self.imu
        return tuple(node for node in nodes if node is not None)

    @property
    def _drives(self) -> tuple[DriveNode | Twin, ...]:
        """All motor drives."""
        return (*(() if self.drive is None else (self.drive,)), *self.twins)

    @property
    def _devices(self) -> tuple[Node | Twin, ...]:
        """All nodes and drives, in the order in which they are powered up."""
        return (*self.nodes, *self.twins)

    @property
    def now_ns(self) -> int:
        """Present time [ns]."""
        return self.bus.now_ns

    @property
    def next_event_ns(self) -> int | None:
        """Time of the next event on any bus, unless other programs send; None: there is none."""
        events = [bus.next_event_ns for bus in self.buses.values()]
        return min((each for each in events if each is not None), default=None)

    def bus_of(self, node: str) -> Bus:
        """Return the bus of a node, or of the drive if there is no node of that name."""
        config = self.config
        drives = {motor.name: motor.bus for motor in config.motors}
        buses = {**drives, **config.nodes}
        first = next(iter(drives.values()), "")
        is_known = node in NODE_NAMES or node in drives
        return self.buses.get(buses.get(node, "") if is_known else first, self.bus)

    def warm(self) -> None:
        """Compile, or load from the cache, the functions that the first steps need."""
        fd_bits.warm()
        self.plant.warm()
        self._ring.warm()

    def advance(self, until_ns: int) -> None:
        """Let time pass up to and including `until_ns` [ns].

        Raises
        ------
        ValueError
            If `until_ns` lies in the past.
        """
        if len(self.buses) == 1:
            self.bus.advance(until_ns)
            return
        while self.now_ns < until_ns:
            event_ns = self.next_event_ns
            step_ns = until_ns if event_ns is None else min(event_ns, until_ns)
            # The bus with the event last, so that its receivers see no bus that lags.
            for bus in sorted(self.buses.values(), key=lambda each: each.next_event_ns == step_ns):
                bus.advance(step_ns)

    def power_cycle(self, name: str = "") -> None:
        """Switch the supply of a node, or of all, off and on; robot and room stay."""
        for node in self._devices:
            if name in ("", node.name):
                self.power_off(node)
                self.power_up(node)

    def power_off(self, node: Node | Twin) -> None:
        """Switch off the supply of a node: it leaves the bus, and a drive's bridges open."""
        self._supplied.discard(node.name)
        self._shut_down(node)

    def power_up(self, node: Node | Twin) -> None:
        """Switch on the supply of a node: it boots, a drive once its supply is high enough."""
        self._supplied.add(node.name)
        if node in self._drives:
            self.supervise()
        else:
            self._boot(node)

    def supervise(self) -> None:
        """Hold the drives in reset, or let them boot, according to their supply."""
        held = self._stage.holds_in_reset()
        for drive in self._drives:
            if held and self.runs(drive):
                self._shut_down(drive)
            elif not held and not self.runs(drive) and drive.name in self._supplied:
                self._boot(drive)

    def runs(self, node: Node | Twin) -> bool:
        """Whether a node has its supply and is not held in reset."""
        return node.name in self._ports

    def _shut_down(self, node: Node | Twin) -> None:
        port = self._ports.pop(node.name, None)
        if port is not None:
            port.detach()
        if node in self._drives:
            self.run_to(self.bus.now_ns)
            for axis in self._axes[node.name]:
                axis.command(Mode.COAST)
            self._stage.steer(self._stage.steering_rad)

    def _boot(self, node: Node | Twin) -> None:
        receive: Callable[[Frame], None] = node.on_frame
        if node is self.drive:
            self.monitor.on_power_up()
            receive = partial(self._deliver_to_drive, receive)
        elif node in self.twins:
            receive = partial(self._deliver_to_twin, receive)
        bus = self.bus_of(node.name)
        is_classic = node.name in self.config.simulation.classic_nodes
        fd = FdSupport.INTOLERANT if is_classic else FdSupport.ENABLED
        port = bus.attach(node.name, receive, accept=node.arbitration_ids, fd=fd)
        self._ports[node.name] = port
        wake = partial(self._wake, bus, node)
        node.connect(port, lambda due_ns, _: bus.schedule(due_ns, wake))
        node.power_cycle(self.bus.now_ns)

    @property
    def people_m(self) -> tuple[tuple[float, float], ...]:
        """Present places of the people: x, y in world [m]."""
        if self._people is None:
            return ()
        self.run_to(self.bus.now_ns)
        return self._people.places_m

    def pose(self) -> tuple[float, float, float]:
        """Return the true pose of base in world at the present time: x, y [m], heading [rad]."""
        self.run_to(self.bus.now_ns)
        plant = self.plant
        return plant.x_m, plant.y_m, plant.theta_rad

    def truth(self, *, origin_ns: int = 0, late: int = 0, late_max_ns: int = 0) -> Truth:
        """Return the ground truth at the present time.

        Parameters
        ----------
        origin_ns
            Added to the time stamp: CLOCK_MONOTONIC at time 0 of the simulation [ns].
        late, late_max_ns
            Values for `Truth`.
        """
        stamp_ns = self.run_to(self.bus.now_ns) + origin_ns
        plant, buses, findings = self.plant, self.buses.values(), self.monitor.findings
        people = self._people
        return Truth(
            stamp_ns=stamp_ns,
            x_m=plant.x_m,
            y_m=plant.y_m,
            theta_rad=plant.theta_rad,
            v_m_s=plant.v_m_s,
            vy_m_s=plant.vy_m_s,
            omega_rad_s=plant.omega_rad_s,
            distance_m=plant.distance_m,
            collisions=plant.collisions + (0 if people is None else people.hit),
            charge=plant.charge,
            bus_frames=sum(bus.statistics.frames for bus in buses),
            bus_load=max(bus.load() for bus in buses),
            bus_errors=sum(sum(bus.statistics.errors.values()) for bus in buses),
            late=late,
            late_max_ns=late_max_ns,
            power_off_ns=self.monitor.power_off_ns + origin_ns,
            unsafe_motions=self.monitor.count,
            unsafe_reason=findings[-1].reason if findings else "",
            ran_into=0 if people is None else people.ran_into,
            people=self.people_m,
            body=plant.body_state,
        )

    def scan(self, number: int = 0, *, origin_ns: int = 0) -> Scan | None:
        """Return a scan of a lidar that ends at the robot's present pose; None without a lidar.

        `origin_ns` is added to the time stamp, as in `truth`.
        """
        if not self._lidars:
            return None
        lidar = self._lidars[number]
        now_ns = self.run_to(self.bus.now_ns)
        stamp_ns = now_ns + origin_ns
        plant, mount = self.plant, lidar.parameters
        if mount.sweep_s == 0.0:
            ranges_m = lidar.scan(plant.x_m, plant.y_m, plant.theta_rad)
        else:
            ranges_m = lidar.sweep(self._poses(now_ns - 1e9 * lidar.ages_s))
        angles_rad = lidar.angles_rad
        return Scan(
            stamp_ns=stamp_ns,
            x_m=mount.x_m,
            y_m=mount.y_m,
            first_rad=float(angles_rad[0]),
            step_rad=float(angles_rad[1] - angles_rad[0]),
            max_range_m=mount.max_range_m,
            ranges=ranges_m.astype("<f4").tobytes(),
            name=mount.name,
            sweep_s=mount.sweep_s,
        )

    def _poses(self, stamps_ns: np.ndarray) -> np.ndarray:
        """Return where the robot was lately, (n, 3); before it was anywhere, where it began."""
        times, *path = np.array(self._path).T
        path[2] = np.unwrap(path[2])
        return np.stack([np.interp(stamps_ns, times, each) for each in path], axis=1)

    def camera_frame(self, *, origin_ns: int = 0) -> Picture | None:
        """Return a picture from the robot's present pose; None if it has no camera.

        The first picture takes seconds, to prepare the camera for this world. `origin_ns` is added
        to the time stamp, as in `truth`. The caller applies `[simulation.camera] latency_ms`.
        """
        if self.config.camera is None:
            return None
        if self._camera is None:
            from firmware_sim.camera.camera import Camera  # noqa: PLC0415 - most simulations take none

            self._camera = Camera(self.config, self.world, self._seed)
        stamp_ns = self.run_to(self.bus.now_ns) + origin_ns
        plant, number = self.plant, self._pictures
        self._pictures += 1
        view = self._camera.look(plant.x_m, plant.y_m, plant.theta_rad, number)
        return view.framed(stamp_ns, number)

    def run_to(self, now_ns: int) -> int:
        """Bring the plant to the last whole millisecond up to `now_ns`; return that time [ns]."""
        if self._people is not None:
            while self._people_ns + PEOPLE_STEP_NS <= now_ns:
                self._people_ns += PEOPLE_STEP_NS
                self._step_plant(self._people_ns)
                self._let_walk(self._people)
        return self._step_plant(now_ns)

    def _let_walk(self, people: People) -> None:
        """Let people walk, and connect them to plant and sensors."""
        before, self._motion_before = self._motion_before, self.plant.motion
        people.step(self._people_ns, partial(self.plant.contact, motion=before), self._as_mover)
        self.plant.discs = people.discs
        self._ring.walls.moving = sides = people.sides
        for lidar in self._lidars:
            lidar.walls.moving = sides

    def _as_mover(self) -> Mover:
        """Return the robot as people who look see it."""
        plant = self.plant
        pose = plant.x_m, plant.y_m, plant.theta_rad
        return self._discs[plant.body_state].moving(pose, plant.motion)

    def _step_plant(self, now_ns: int) -> int:
        steps = (now_ns - self._plant_ns) // STEP_NS
        if steps > 0:
            self.plant.step(steps)
            self._plant_ns += steps * STEP_NS
        if self._path_ns and (steps or not self._path):
            self._remember()
        return self._plant_ns

    def _remember(self) -> None:
        """Keep the present pose as long as a sweep may ask for it, and one before."""
        path, plant = self._path, self.plant
        path.append((self._plant_ns, plant.x_m, plant.y_m, plant.theta_rad))
        while len(path) > 2 and path[1][0] <= self._plant_ns - self._path_ns:
            path.popleft()

    def _make_drive(self, memory: Memory) -> DriveNode | None:
        """Return our own motor controller, if the robot has one."""
        table = next((each for each in self.config.motors if each.kind == OWN_KIND), None)
        if table is None:
            return None
        wheels, axes = self.config.drive.wheel_names, self._stage.axes
        true = self.config.simulation.twin.get(table.name, {})
        fitted = motor_table({**table.keys, **true}).axes
        driven: list[MotorAxis] = [
            Motor(axes[wheels.index(each.actuator)], -1.0)
            if each.reversed
            else axes[wheels.index(each.actuator)]
            for each in sorted(fitted, key=lambda each: each.axis)
            if each.actuator in wheels
        ]
        self._axes[table.name] = driven
        motor = self.config.simulation.motor
        model = MotorModel(
            resistance_ohm=motor.resistance_ohm,
            back_emf_v_s_rad=motor.back_emf_v_s_rad * motor.gear_ratio,
            current_limit_a=motor.current_limit_a,
            counts_per_revolution=int(
                true.get("counts_per_revolution", self.config.drive.counts_per_revolution)
            ),
        )
        return DriveNode(
            self._stage,
            driven,
            self.run_to,
            model,
            self._store("drive", memory),
            current_limit_ma=_current_limit_ma(self.config),
        )

    def _make_twins(self, memory: Memory) -> tuple[Twin, ...]:
        """Return the twins of the bought drives."""
        config, twins = self.config, []
        wheels, axes = config.drive.wheel_names, self._stage.axes
        for table in config.motors:
            if table.kind == OWN_KIND:
                continue
            drive, settings = true_drive(table, config.simulation.twin.get(table.name, {}))
            motors = [
                Motor(axes[wheels.index(each.actuator)], each.motor_per_wheel)
                for each in drive.axes
                if each.actuator in wheels
            ]
            self._axes[table.name] = list(motors)
            store = self._store(table.name, memory)
            twins.append(drive.make(settings, motors, self._stage, self.run_to, store))
        return tuple(twins)

    def _deliver_to_drive(self, receive: Callable[[Frame], None], frame: Frame) -> None:
        self.monitor.on_delivery(frame)
        receive(frame)

    def _deliver_to_twin(self, receive: Callable[[Frame], None], frame: Frame) -> None:
        self.monitor.on_foreign_frame(frame.stamp_ns)
        receive(frame)

    def _store(self, name: str, memory: Memory) -> FragileStore:
        store = self.stores[name] = FragileStore(memory(name))
        return store

    def _wake(self, bus: Bus, node: Node | Twin) -> None:
        if node.name in self._ports:
            node.wake(bus.now_ns)

    def _motion(self) -> Motion:
        plant = self.plant
        return Motion(plant.powered, *plant.motion, plant.steering_rad)

    def _watch(self) -> None:
        """Start the periodic checks of the safety monitor."""
        now_ns = self.bus.now_ns
        self.run_to(now_ns)
        self.monitor.look(now_ns)
        self.bus.schedule(now_ns + MONITOR_PERIOD_NS, self._watch)

    def _fire(self, group: int, now_ns: int) -> Ranges:
        self.run_to(now_ns)
        plant = self.plant
        return self._faulty_ring.fire(group, plant.x_m, plant.y_m, plant.theta_rad)

    def _measure_motion(self, now_ns: int) -> ImuSample:
        stamp_ns = self.run_to(now_ns)
        plant = self.plant
        motion = BodyMotion(
            plant.x_m, plant.y_m, plant.theta_rad,
            plant.v_m_s, plant.vy_m_s, plant.omega_rad_s,
        )  # fmt: skip
        return self._imu.sample(stamp_ns, motion)

    def _measure_battery(self, now_ns: int) -> BatterySample:
        self.run_to(now_ns)
        plant = self.plant
        return BatterySample(
            plant.bus_voltage_v,
            plant.battery_current_a,
            plant.charge,
            self.config.simulation.motor.air_c,
        )


def _check_names(config: RobotConfig) -> None:
    """Raise SimulationError for settings of unknown nodes."""
    named = (("nodes", config.nodes), ("simulation.classic_nodes", config.simulation.classic_nodes))
    for key, names in named:
        for name in names:
            if name not in NODE_NAMES:
                hint = nearest(name, NODE_NAMES) or f"; allowed: {', '.join(NODE_NAMES)}"
                raise SimulationError(f"{key}: no node {name!r}{hint}")


def _allowed(config: RobotConfig) -> Allowed:
    """Return the limits by which the monitor judges a robot."""
    timeout_ns = config.safety.command_timeout_ms * 1_000_000
    limits = config.limits
    return Allowed(
        limits.v_max_m_s, limits.omega_max_rad_s, power_ns=timeout_ns + TIMEOUT_MARGIN_NS
    )


def _current_limit_ma(config: RobotConfig) -> int:
    """Return the factory setting of the over-current limit, below the stall current [mA].

    It is rounded to coarse steps, since motors are not known better than that.
    """
    motor = config.simulation.motor
    stall_a = config.simulation.battery.cells * CELL_V / motor.resistance_ohm
    limit_ma = CONTINUOUS_SHARE * min(stall_a, motor.current_limit_a) * 1e3
    return max(round(limit_ma / CURRENT_STEP_MA), 1) * CURRENT_STEP_MA


def _lidars(
    tables: Sequence[LidarParameters], room: World, noise: np.random.Generator
) -> list[Lidar]:
    """Return the lidars of a robot; the first one's noise is as if it were alone."""
    noises = [noise, *noise.spawn(max(len(tables) - 1, 0))]
    return [
        Lidar(each, room.seen_from(each.z_m), own)
        for each, own in zip(tables, noises, strict=False)
    ]


def _memory(directory: Path | None) -> Memory:
    if directory is None:
        return lambda _name: MemoryStore()
    return lambda name: FileStore(directory, name)
