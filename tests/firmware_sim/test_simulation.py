"""The whole simulated robot under virtual time: real bus, real plant, real nodes."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec
import numpy as np
import pytest
from e2e import p01

from firmware_sim.bus.log import LogWriter
from firmware_sim.nodes.drive_guards import DriveFault
from firmware_sim.nodes.drive_state import DriveState
from firmware_sim.simulation import Simulation
from firmware_sim.world.truth import Scan

CONFIGS = Path(__file__).parents[2] / "configs"
MS = 1_000_000
PERIOD_NS = 5 * MS
KINDS = ("diff_drive", "tricycle", "ackermann")


class Host:
    """Attaches to a simulation, starts its nodes and commands the drive."""

    def __init__(self, simulation):
        self.simulation = simulation
        self.frames = []
        self.port = simulation.bus.attach("host", self.frames.append)
        self.counter = 0
        simulation.advance(simulation.now_ns + 20 * MS)
        self.start()

    def start(self):
        self.port.send(0x000, b"\x01\x00")

    def command(self, enable=True, duty1=0.0, duty2=0.0, steering=0.0):
        data = bytearray(2)
        data[1] = self.counter | enable << 4
        self.counter = (self.counter + 1) % 15
        for value in (duty1, duty2, steering):
            data += round(value * 1e4).to_bytes(2, "little", signed=True)
        p01.e2e_p01_protect(data, 0xA201, length=8, increment_counter=False)
        self.port.send(0x201, bytes(data))

    def tick(self, **command):
        self.command(**command)
        self.port.send(0x080)
        self.simulation.advance(self.simulation.now_ns + PERIOD_NS)

    def ticks(self, seconds, **command):
        for _ in range(round(seconds * 1e9 / PERIOD_NS)):
            self.tick(**command)

    def of(self, arbitration_id):
        return [frame for frame in self.frames if frame.arbitration_id == arbitration_id]


def simulate(kind="diff_drive", world="empty_room", seed=1, **options):
    robot, room = CONFIGS / f"{kind}.toml", CONFIGS / "worlds" / f"{world}.toml"
    return Simulation(robot, room, seed, **options)


@pytest.fixture
def simulation():
    return simulate()


def log_of_a_run(path, seed, chunk_ns):
    """Drive two seconds, letting time pass in chunks; return log and last truth."""
    simulation = simulate(seed=seed, world="flat")
    rng = np.random.default_rng(7)
    with LogWriter(simulation.bus, path):
        host = Host(simulation)
        for _ in range(400):
            host.command(duty1=rng.uniform(-0.4, 0.5), duty2=rng.uniform(-0.4, 0.5))
            host.port.send(0x080)
            end_ns = simulation.now_ns + PERIOD_NS
            while simulation.now_ns < end_ns:
                simulation.advance(min(simulation.now_ns + chunk_ns, end_ns))
    return path.read_bytes(), msgspec.structs.astuple(simulation.truth())


class TestDeterminism:
    def test_the_same_seed_gives_the_same_log_byte_for_byte(self, tmp_path):
        first = log_of_a_run(tmp_path / "a.log", 5, PERIOD_NS)
        assert log_of_a_run(tmp_path / "b.log", 5, PERIOD_NS) == first
        assert first[0].count(b"\n") > 1500

    def test_how_time_is_cut_into_pieces_makes_no_difference(self, tmp_path):
        whole = log_of_a_run(tmp_path / "a.log", 5, PERIOD_NS)
        pieces = log_of_a_run(tmp_path / "b.log", 5, 137_000)
        assert hashlib.sha256(pieces[0]).digest() == hashlib.sha256(whole[0]).digest()

    def test_another_seed_gives_another_log(self, tmp_path):
        assert (
            log_of_a_run(tmp_path / "a.log", 5, PERIOD_NS)[0]
            != log_of_a_run(tmp_path / "b.log", 6, PERIOD_NS)[0]
        )


class TestNodesOnTheBus:
    def test_the_nodes_boot_in_order_and_beat(self, simulation):
        host = Host(simulation)
        boots = [f for f in host.frames if f.arbitration_id >> 7 == 0x0E and f.data == b"\0"]
        assert [(f.arbitration_id, f.stamp_ns // MS) for f in boots] == [
            (0x701, 5), (0x702, 6), (0x703, 7),
        ]  # fmt: skip
        simulation.advance(1000 * MS)
        for node in (1, 2, 3):
            assert len(host.of(0x700 + node)) == 10

    def test_in_operational_all_process_data_flow(self, simulation):
        host = Host(simulation)
        host.ticks(1.0, enable=False)
        counts = {each: len(host.of(each)) for each in (0x181, 0x281, 0x381, 0x182, 0x282, 0x183)}
        assert counts[0x181] in {199, 200}
        assert counts[0x281] == counts[0x381] == 50
        assert counts[0x182] == counts[0x282] == 20
        assert counts[0x183] in {9, 10}
        assert 0.05 < simulation.bus.load() < 0.5

    def test_a_power_cycle_boots_all_nodes_and_restarts_their_counts(self, simulation):
        host = Host(simulation)
        host.ticks(0.5, duty1=0.3, duty2=0.3)
        assert int.from_bytes(host.of(0x181)[-1].data[4:6], "little") > 300
        before = simulation.truth()
        del host.frames[:]
        simulation.power_cycle()
        simulation.advance(simulation.now_ns + 20 * MS)
        assert [len(host.of(0x700 + node)) for node in (1, 2, 3)] == [1, 1, 1]
        assert simulation.drive.drive_state is DriveState.BOOT
        host.start()
        host.tick(enable=False)
        feedback = host.of(0x181)[-1].data
        assert int.from_bytes(feedback[4:6], "little") < 300
        assert int.from_bytes(feedback[0:4], "little") >> 12 < 30_000
        assert simulation.truth().x_m >= before.x_m

    def test_the_motors_coast_after_a_power_cycle(self, simulation):
        host = Host(simulation)
        host.ticks(0.5, duty1=0.5, duty2=0.5)
        simulation.power_cycle()
        simulation.advance(simulation.now_ns + 1000 * MS)
        assert abs(simulation.truth().v_m_s) < 0.3
        assert simulation.plant.axes[0].current_a == pytest.approx(0.0, abs=1e-6)

    def test_stored_parameters_live_in_the_state_directory(self, tmp_path):
        host = Host(simulate(state_directory=tmp_path))
        for request in ("2b00200050000000", "2310100173617665"):
            host.port.send(0x601, bytes.fromhex(request))
            host.simulation.advance(host.simulation.now_ns + 2 * MS)
        again = Host(simulate(state_directory=tmp_path))
        again.port.send(0x601, bytes.fromhex("4000200000000000"))
        again.simulation.advance(again.simulation.now_ns + 2 * MS)
        assert again.of(0x581)[-1].data[4] == 80


class TestSafety:
    @pytest.mark.parametrize("timeout_ms", [10, 100])
    def test_the_dead_man_stops_the_motors_at_the_time_out_to_the_bit(self, simulation, timeout_ms):
        host = Host(simulation)
        request = bytes.fromhex("2b002000") + timeout_ms.to_bytes(4, "little")
        host.port.send(0x601, request)
        host.ticks(0.5, duty1=0.3, duty2=0.3)
        heard = []
        simulation.bus.tap(heard.append)
        host.command(duty1=0.3, duty2=0.3)
        simulation.advance(simulation.now_ns + 1000 * MS)
        command_ns = next(f.stamp_ns for f in heard if f.arbitration_id == 0x201)
        emergency = next(f for f in heard if f.arbitration_id == 0x081)
        assert emergency.data[:2] == bytes.fromhex("3081")
        wire_ns = 150_000  # an EMCY at 1 Mbit/s, and one frame it may have to wait for
        assert 0 < emergency.stamp_ns - command_ns - timeout_ms * MS < 2 * wire_ns
        assert simulation.drive.drive_state is DriveState.STOPPED
        assert simulation.truth().v_m_s == pytest.approx(0.0, abs=0.01)

    def test_an_emergency_stop_from_anybody_stops_the_wheels(self, simulation):
        host = Host(simulation)
        host.ticks(0.5, duty1=0.4, duty2=0.4)
        assert simulation.truth().v_m_s > 0.2
        stranger = simulation.bus.attach("button", lambda frame: None)
        stranger.send(0x001)
        host.ticks(0.5, duty1=0.4, duty2=0.4)
        assert simulation.truth().v_m_s == pytest.approx(0.0, abs=0.01)
        assert simulation.drive.drive_state is DriveState.EMERGENCY_STOP


class TestGuardsOnThePlant:
    @pytest.mark.parametrize("kind", KINDS)
    @pytest.mark.parametrize("seed", [1, 2, 3])
    def test_wild_driving_makes_no_encoder_fault(self, kind, seed):
        simulation = simulate(kind)
        host = Host(simulation)
        rng = np.random.default_rng(seed)
        for _ in range(60):
            duty1, duty2 = rng.uniform(-1, 1, 2) * rng.choice([0.1, 0.4, 1.0])
            command = {"duty1": duty1, "duty2": duty2 if kind == "diff_drive" else 0.0}
            host.ticks(rng.uniform(0.005, 0.3), steering=rng.uniform(-0.4, 0.4), **command)
            assert DriveFault.ENCODER not in simulation.drive.faults

    @pytest.mark.parametrize("kind", KINDS)
    def test_a_blocked_wheel_is_an_over_current_and_no_encoder_fault(self, kind):
        simulation = simulate(kind)
        simulation.plant.axes[0].block()
        host = Host(simulation)
        host.ticks(1.5, duty1=1.0)
        assert simulation.drive.faults == DriveFault.OVER_CURRENT
        assert simulation.drive.drive_state is DriveState.FAULT

    @pytest.mark.parametrize("kind", KINDS)
    @pytest.mark.parametrize("sign", [0, -1])
    def test_a_broken_or_swapped_encoder_is_found(self, kind, sign):
        simulation = simulate(kind)
        simulation.faults.stage.axes[0].own_encoder.begin(sign)
        host = Host(simulation)
        host.ticks(1.0, duty1=0.5, duty2=0.5 if kind == "diff_drive" else 0.0)
        assert simulation.drive.faults == DriveFault.ENCODER
        assert simulation.truth().v_m_s == pytest.approx(0.0, abs=0.02)

    def test_an_empty_battery_is_an_under_voltage(self, simulation):
        host = Host(simulation)
        simulation.plant.charge = 0.0
        host.ticks(3.0, enable=False)
        low = simulation.plant.bus_voltage_v < 9.0
        assert (DriveFault.UNDER_VOLTAGE in simulation.drive.faults) is low


class TestTruth:
    def test_it_is_the_plants_state_at_the_present_millisecond(self, simulation):
        host = Host(simulation)
        host.ticks(1.0, duty1=0.3, duty2=0.35)
        simulation.advance(simulation.now_ns + 700_000)
        truth = simulation.truth(origin_ns=10**12, late=3)
        assert truth.stamp_ns == 10**12 + simulation.now_ns // MS * MS
        assert (truth.x_m, truth.y_m) == (simulation.plant.x_m, simulation.plant.y_m)
        assert truth.theta_rad > 0.05
        assert truth.bus_frames == len(host.frames) + host.port.statistics.sent
        assert (truth.bus_errors, truth.late) == (0, 3)

    def test_a_start_pose_can_be_chosen(self):
        truth = simulate(start=(1.5, 1.25, 0.5)).truth()
        assert (truth.x_m, truth.y_m, truth.theta_rad) == pytest.approx((1.5, 1.25, 0.5))

    def test_without_a_lidar_there_are_no_scans(self, simulation):
        assert (simulation.scan() is None) is (not simulation.config.simulation.lidars)

    def test_several_lidars_scan_each_from_its_mount(self):
        from firmware_sim.config.config import load_robot

        lidars = [
            {"name": "front", "x_m": 0.2, "sigma_m": 0.0, "dropout_probability": 0.0},
            {"name": "rear", "x_m": -0.2, "sweep_s": -0.1, "sigma_m": 0.0,
             "dropout_probability": 0.0},
        ]  # fmt: skip
        config = load_robot(CONFIGS / "diff_drive.toml", {"simulation.lidar": lidars})
        simulation = Simulation(config, CONFIGS / "worlds" / "empty_room.toml", 1)
        simulation.advance(200_000_000)
        front, rear = (simulation.scan(number) for number in (0, 1))
        assert (front.name, front.x_m, front.sweep_s) == ("front", 0.2, 0.0)
        assert (rear.name, rear.x_m, rear.sweep_s) == ("rear", -0.2, -0.1)
        # It stands: the wall ahead is as much farther from the one as from the other behind.
        ahead = [np.frombuffer(each.ranges, "<f4")[180] for each in (front, rear)]
        assert ahead[1] - ahead[0] == pytest.approx(0.4, abs=1e-4)

    def test_a_lidars_scan_travels_as_float32(self):
        from firmware_sim.config.config import load_robot

        config = load_robot(
            CONFIGS / "diff_drive.toml",
            {"simulation.lidar.beams": 90, "simulation.lidar.fov_deg": 180.0},
        )
        simulation = Simulation(config, CONFIGS / "worlds" / "empty_room.toml", 1)
        packed = msgspec.msgpack.encode(simulation.scan())
        scan = msgspec.msgpack.decode(packed, type=Scan)
        ranges = np.frombuffer(scan.ranges, "<f4")
        assert len(ranges) == 90
        assert np.all(ranges[np.isfinite(ranges)] > 0.05)
        assert scan.first_rad == pytest.approx(-np.pi / 2, abs=0.05)
        assert scan.first_rad + 89 * scan.step_rad == pytest.approx(np.pi / 2, abs=0.05)
