"""The long mission with random faults, for some minutes of it."""

import pytest

import endurance
from endurance import Endurance
from robotctl.config.robot_file import find_file
from robotctl.messages.control import EmergencyStop, EmergencyStopSource, SafetyState

MINUTE_NS = 60 * endurance.SECOND_NS
NAMES = {"node": {"drive", "sonar", "power"}, "drive": {"drive"}}
"""Parts of the differential robot by the fault's parameter; all others are wheels."""


@pytest.mark.parametrize("robot", ["diff_drive", "tricycle", "ackermann"])
def test_every_robot_gets_the_faults_that_it_can_feel_and_recovers(robot, capsys):
    run = Endurance(find_file(robot), seed=5, mean_s=2.0)
    run.run_until(MINUTE_NS)
    assert run.faults.total() > 12
    assert run.stops.total() > 3
    # The last one may still be under way.
    assert run.recoveries in {run.stops.total(), run.stops.total() - 1}
    assert run.simulation.monitor.count == 0
    assert run.failed_recoveries == 0
    endurance.conclude(run, 0.0)
    wanted = f"{run.recoveries} recoveries from {run.stops.total()} stops"
    assert wanted in capsys.readouterr().out


def test_every_number_of_every_fault_is_drawn_within_its_bounds():
    run = Endurance(find_file("diff_drive"), seed=5, mean_s=float("inf"))
    supply_v = run.simulation.plant.bus_voltage_v
    for kind in endurance.FAULTS.values():
        draws = [run._arguments(kind, 100_000_000) for _ in range(300)]
        for name, parameter in kind.parameters.items():
            drawn = [kind.value(name, each[name]) for each in draws]
            if parameter.named:
                assert set(drawn) == NAMES.get(name, {"left", "right"})
            elif parameter.words:
                assert set(drawn) == set(parameter.words)
            elif name == endurance.DURATION:
                assert set(drawn) == {0.1}
            elif name == "id":
                assert set(drawn) == set(endurance.IDENTIFIERS)
            elif name == "code":
                assert len(set(drawn)) >= 290
                assert 0.0 <= min(drawn) < 0x1000_0000 < 0xF000_0000 < max(drawn) <= 0xFFFF_FFFF
            else:
                assert len(set(drawn)) >= (8 if name in {"sonar", "other"} else 290)
                assert min(drawn) <= float(parameter.default)
                assert max(drawn) > 0.5 * float(parameter.default)
            if name in {"delay", "sag"}:
                assert max(drawn) <= 1.5
                assert min(drawn) < 0.01
            if name == "volts":
                assert max(drawn) < supply_v


def test_without_faults_laps_are_completed_and_nothing_is_recovered_from(capsys):
    run = Endurance(find_file("diff_drive"), seed=5, mean_s=float("inf"))
    while run.laps.total() < 2 and run.now_ns < 4 * MINUTE_NS:
        run.run_until(run.now_ns + 10 * endurance.SECOND_NS)
    assert run.laps == {"completed": 2}
    assert (run.faults.total(), run.stops.total(), run.recoveries) == (0, 0, 0)
    assert endurance.conclude(run, 0.0) == 0
    assert f"{run.laps.total()}  completed" in capsys.readouterr().out


def test_a_robot_that_cannot_be_armed_again_is_found_though_faults_go_on(monkeypatch, capsys):
    run = Endurance(find_file("diff_drive"), seed=5, mean_s=2.0)
    run.run_until(20 * endurance.SECOND_NS)
    monkeypatch.setattr(run.stack.core, "_try_to_arm", lambda _now_ns: False)
    while not run.failed_recoveries and run.now_ns < MINUTE_NS:
        run.run_until(run.now_ns + 5 * endurance.SECOND_NS)
    assert run.failed_recoveries > 0
    assert "not recovered" in capsys.readouterr().out
    assert endurance.conclude(run, 0.0) == 1


def test_a_run_without_a_completed_lap_has_failed():
    run = Endurance(find_file("diff_drive"), seed=5, mean_s=float("inf"))
    run.run_until(10 * endurance.SECOND_NS)
    assert endurance.conclude(run, 0.0) == 1


def test_an_emergency_stop_of_a_robot_that_is_disarmed_between_laps_is_recovered_from():
    run = Endurance(find_file("diff_drive"), seed=5, mean_s=float("inf"))
    run.run_until(10 * endurance.SECOND_NS)
    run.stack.tick(run._begin_lap(run.now_ns))
    run.run_until(run.now_ns + endurance.SECOND_NS // 10)
    assert run.stack.snapshot().state == SafetyState.STANDBY
    run.stack.tick((EmergencyStop(run.now_ns, EmergencyStopSource.OPERATOR),))
    run.run_until(run.now_ns + 5 * endurance.SECOND_NS)
    assert run.stops == {"EMERGENCY_STOP": 1}
    assert run.recoveries == 1


def test_a_new_fault_while_the_robot_stands_does_not_shorten_its_recovery():
    run = Endurance(find_file("diff_drive"), seed=5, mean_s=float("inf"))
    run.run_until(10 * endurance.SECOND_NS)
    run.stack.tick((EmergencyStop(run.now_ns, EmergencyStopSource.OPERATOR),))
    for _ in range(4):  # the operator never sees half a second without one
        run.run_until(run.now_ns + 4 * endurance.SECOND_NS // 10)
        run._fault_end_ns = run.now_ns + endurance.SECOND_NS // 10
        run.run_until(run._fault_end_ns)
    assert run.recoveries == 0
    run.run_until(run.now_ns + 5 * endurance.SECOND_NS)
    assert run.recoveries == 1
    # Four times 0.4 s, and the half second before he arms.
    assert 1.6 + 0.5 - 0.3 <= run.slowest_recovery_s < 5.0
