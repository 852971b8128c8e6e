"""Lines that begin faults, the catalogue, and the robot after faults."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_sim.bus.errors import ErrorState
from firmware_sim.errors import SimulationError
from firmware_sim.faults.catalogue import CATALOGUE
from tests.firmware_sim.faults.fault_bench import FEEDBACK, MS, Bench


@pytest.mark.parametrize(
    "line",
    ["encoder_stuck", "encoder_reversed", "wheel_blocked", "under_voltage volts=3", "brown_out"],
)
def test_a_fault_begins_and_ends_at_its_time_though_nobody_has_looked_at_the_robot(line):
    """The robot is simulated when something touches it; here once as well right before a fault."""

    def run(*, looked_at):
        bench = Bench()
        bench.drive(0.5)
        simulation = bench.simulation
        now_ns = simulation.now_ns
        if looked_at:
            for due_ns in (now_ns + 4 * MS, now_ns + 12 * MS):
                simulation.bus.schedule(due_ns, lambda: simulation.run_to(simulation.now_ns))
        bench.run(4)
        bench.begin(f"{line} duration=0.008")
        bench.run(20)
        simulation.run_to(simulation.now_ns)
        stage, plant = simulation.faults.stage, simulation.plant
        counts = [axis.socket.count for axis in stage.axes]
        return counts, plant.axes[0].speed_rad_s, plant.x_m

    assert run(looked_at=False) == run(looked_at=True)


class TestLines:
    @pytest.mark.parametrize(
        ("line", "problem"),
        [
            ("encoder_stck", "fault 'encoder_stck': unknown; did you mean \"encoder_stuck\"?"),
            ("CLEAR", "fault 'CLEAR': unknown; did you mean \"clear\"?"),
            ("\x1c", f"fault '': unknown, allowed: {', '.join([*CATALOGUE, 'clear'])}"),
            ("encoder_stuck wheel", "fault encoder_stuck: 'wheel' is not of the form key=value"),
            ("node_cut node=drive node=sonar", "fault node_cut: node is given twice"),
            (
                "encoder_stuck weel=left",
                (
                    "fault encoder_stuck: weel: unknown, allowed: wheel, duration; "
                    'did you mean "wheel"?'
                ),
            ),
            (
                "encoder_stuck wheel=middle",
                (
                    "fault encoder_stuck: wheel: 'middle', the differential drive has no such "
                    "wheel, allowed: left, right, drive"
                ),
            ),
            ("bus_cut duration=long", "fault bus_cut: duration: 'long' is no number"),
            ("bus_cut duration=0x", "fault bus_cut: duration: '0x' is no number"),
            (
                f"bus_cut duration=0x{999 * 'f'}",
                "fault bus_cut: duration: '0xffffffffff...fffffffffffff' is no number",
            ),
            ("bus_cut duration=nan", "fault bus_cut: duration: nan, allowed: 0.001 to 3600"),
            ("frames_lost id=513.5", "fault frames_lost: id: 513.5 is no whole number"),
            ("frames_lost id=nan", "fault frames_lost: id: nan is no whole number"),
            (
                "frames_lost id=0xA0000000",
                "fault frames_lost: id: 2684354560, allowed: 0 to 2684354559",
            ),
            ("bus_cut duration=0", "fault bus_cut: duration: 0, allowed: 0.001 to 3600"),
        ],
    )
    def test_a_wrong_line_is_refused_with_what_is_allowed(self, bench, line, problem):
        with pytest.raises(SimulationError) as caught:
            bench.simulation.faults.inject(line)
        assert str(caught.value) == problem

    def test_a_fault_ends_by_itself_after_its_duration(self, driving):
        driving.begin("encoder_stuck duration=0.1")
        driving.drive(0.2)
        left = driving.counts()[:, 0]
        assert np.ptp(left[:19]) == 0
        assert np.diff(left[21:]).min() > 0


@pytest.mark.parametrize(("robot", "seed"), [("diff_drive", 1), ("tricycle", 2), ("ackermann", 3)])
def test_after_any_mixture_of_faults_the_robot_is_as_sound_as_before(robot, seed):
    bench = Bench(robot)
    rng = np.random.default_rng(seed)
    robot_file = bench.simulation.config
    felt = [
        name
        for name, kind in CATALOGUE.items()
        if not any(kind.fits(robot_file, kind.complete({})))
    ]
    bench.drive(0.5, 0.2, 0.2)
    for _ in range(200):
        name = str(rng.choice(felt))
        duration = f" duration={rng.uniform(0.05, 0.5):.3f}"
        bench.begin(name + (duration if "duration" in CATALOGUE[name].parameters else ""))
        bench.drive(0.05, 0.2, 0.2)
    bench.clear()
    bench.drive(1.0, 0.0, 0.0, enable=False)
    for node in (1, 2, 3):  # what was lost must be stored anew
        bench.port.send(0x600 + node, b"\x23\x10\x10\x01save")
    bench.run(10)
    bench.begin("node_reset node=drive")  # a trip of its guards stays latched otherwise
    bench.run(20)
    bench.port.send(0x000, b"\x01\x00")
    bench.drive(0.5, 0.0, 0.0, enable=False)
    simulation = bench.simulation
    assert {port.name for port in simulation.bus.ports} == {"drive", "sonar", "power", "host"}
    assert {port.state for port in simulation.bus.ports} <= {
        ErrorState.ERROR_ACTIVE, ErrorState.ERROR_WARNING,
    }  # fmt: skip
    before, true = bench.counts()[-1], bench.true_counts()
    bench.drive(0.5, 0.15, 0.15)
    assert len(bench.of(FEEDBACK)) == 100
    assert simulation.plant.powered
    moved = bench.true_counts() - true
    assert moved[0] > 20
    assert bench.counts()[-1] - before == pytest.approx(moved, abs=0.05 * moved.max() + 1)
    status = bench.status()
    assert status["faults"] == 0
    assert status["current1_a"] == pytest.approx(simulation.plant.axes[0].current_a, abs=0.1)
    assert status["temperature1_c"] == pytest.approx(simulation.plant.axes[0].temperature_c, abs=1)
    assert bench.voltage_v() == pytest.approx(simulation.plant.bus_voltage_v, abs=0.1)
    assert np.diff(bench.stamps_us()) == pytest.approx(5000, abs=1001)
    for node in (1, 2, 3):
        assert bench.read(node, 0x1018, 3) >> 16 == 1


def test_every_default_is_allowed():
    for kind in CATALOGUE.values():
        for key, value in kind.complete({}).items():
            assert kind.value(key, value) == value


def test_the_catalogue_can_be_had_without_a_compiler():
    code = (
        "import sys; import firmware_sim.faults.scenario; "
        "assert not {'numba', 'firmware_sim.plant.plant'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_kind_stands_in_a_test_of_the_simulator():
    files = Path(__file__).parents[1].rglob("test_*.py")
    source = "".join(file.read_text(encoding="utf-8") for file in files)
    assert [name for name in CATALOGUE if f'"{name}' not in source] == []


@pytest.mark.parametrize("line", ["{}", "{} a", "{} a=1 a=2", "bus_cut {}", "bus_cut {}=1"])
def test_very_long_words_of_a_fault_are_shortened(bench, line):
    with pytest.raises(SimulationError) as caught:
        bench.simulation.faults.inject(line.format("x" * 5000))
    assert len(str(caught.value)) < 1000
    assert "xxx...xxx" in str(caught.value)
