"""`robotctl tune`: what it finds, what it writes, and how it refuses."""

import dataclasses
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from robotctl.cli import files
from robotctl.cli.files import write_file
from robotctl.config.patch import round_figures
from robotctl.config.robot_file import find_file, load_robot
from robotctl.control.identification.identification import FirstOrderModel
from robotctl.control.identification.tuning import PidGains, Relay, measure_oscillation
from robotctl.errors import ConfigError
from robotctl.workbench.tuning import tune as tuning
from robotctl.workbench.tuning.fit import (
    WheelFit,
    longest_delay_s,
    relay_model,
    step_gains,
)
from robotctl.workbench.tuning.options import TuneOptions
from robotctl.workbench.tuning.tune import identify, responses, tune
from tests.cli.command import status_of

ROBOTS = ("diff_drive", "tricycle", "ackermann")
DT_S = 0.005
BAD_LEFT_AND_RIGHT = tuple(
    f"control.{wheel}.{setting}"
    for wheel in ("left", "right")
    for setting in ("kp=0.1", "ki=6.0", "kv=0.2", "ks=0.0", "ka=0.0")
)


def silent(_line):
    pass


@pytest.fixture(scope="module")
def tuned():
    """A badly set robot, tuned."""
    return tune(TuneOptions(find_file("diff_drive"), overrides=BAD_LEFT_AND_RIGHT))


def run(*arguments):
    return status_of("tune", *arguments)


# What it finds


def physics(robot):
    """kv and ka of a wheel from the motor's and the body's figures, slip neglected."""
    simulation = load_robot(find_file(robot)).simulation
    drive = load_robot(find_file(robot)).drive
    motor, wheels = simulation["motor"], len(drive.wheel_names)
    ke, ratio = motor["back_emf_v_s_rad"], motor["gear_ratio"]
    volts_per_torque = (motor["resistance_ohm"] + 0.02) / ke
    kv = ke * ratio + volts_per_torque * motor["viscous_n_m_s_rad"] * ratio
    load = simulation["mass_kg"] * drive.wheel_radius_m**2 / wheels + 2e-4
    inertia = motor["rotor_inertia_kg_m2"] * ratio + load / (ratio * motor["gear_efficiency"])
    return kv, volts_per_torque * inertia


@pytest.mark.parametrize("method", ["step", "relay"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_it_finds_what_the_physics_say(robot, method):
    config = load_robot(find_file(robot))
    fits = identify(TuneOptions(find_file(robot), method), config, config.drive.wheel_names, silent)
    kv, ka = physics(robot)
    assert tuple(fits) == config.drive.wheel_names
    for fit in fits.values():
        assert fit.feedforward.kv == pytest.approx(kv, rel=0.01)
        assert fit.feedforward.ka == pytest.approx(ka, rel=0.06)
        assert fit.model.gain == pytest.approx(1.0 / kv, rel=0.02)
        assert fit.model.time_constant_s == pytest.approx(ka / kv, rel=0.2)
        assert DT_S < fit.model.delay_s < longest_delay_s(DT_S)
        assert (fit.ultimate is not None) == (method == "relay")


def test_a_slow_robot_gets_longer_steps_until_they_settle():
    lines = []
    overrides = ("simulation.mass_kg=15",)
    options = TuneOptions(find_file("diff_drive"), overrides=overrides)
    config = load_robot(options.robot, overrides)
    fit = identify(options, config, ("left",), lines.append)["left"]
    assert [float(re.search(r"([\d.]+) s", line)[1]) for line in lines] == [0.7, 1.4]
    assert fit.model.time_constant_s > 0.7 / 5


def test_a_badly_set_robot_becomes_good(tuned):
    assert tuned.objections == []
    assert tuned.shortcomings == []
    assert tuned.before
    for before, after in zip(tuned.before, tuned.after, strict=True):
        assert before.metrics.settling_s is None or before.metrics.settling_s > 0.4
        assert after.metrics.settling_s < 0.3
        assert after.metrics.overshoot < 0.02
        assert abs(after.metrics.steady_state_error) < 0.005


def test_the_relay_method_makes_it_good_too():
    result = tune(TuneOptions(find_file("diff_drive"), "relay", overrides=BAD_LEFT_AND_RIGHT))
    assert result.objections == []
    assert result.shortcomings == []
    assert len(result.after) == len(result.before) > 0
    assert all(after.metrics.settling_s < 0.3 for after in result.after)


def judged(tuned, before, after):
    """The result with other figures at 100 % battery: settling, overshoot, steady-state error."""

    def with_figures(responses, figures):
        keys = ("settling_s", "overshoot", "steady_state_error")
        metrics = dataclasses.replace(responses[0].metrics, **dict(zip(keys, figures, strict=True)))
        return (dataclasses.replace(responses[0], metrics=metrics), responses[1])

    return dataclasses.replace(
        tuned, before=with_figures(tuned.before, before), after=with_figures(tuned.after, after)
    )


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ((0.300, 0.010, 0.0), (0.309, 0.010, 0.0), None),
        ((0.300, 0.010, 0.0), (0.311, 0.010, 0.0), "settles within 0.311 s, before within 0.300 s"),
        ((0.300, 0.010, 0.0), (None, 0.010, 0.0), "does not settle"),
        ((None, 0.010, 0.0), (1.900, 0.010, 0.0), None),
        ((0.300, 0.000, 0.0), (0.300, 0.019, 0.0), None),
        ((0.300, 0.000, 0.0), (0.300, 0.021, 0.0), "overshoots by 2.1%, before by 0.0%"),
        ((0.300, 0.030, 0.0), (0.300, 0.034, 0.0), None),
    ],
)
def test_worse_is_what_shows_beyond_the_repeatability(tuned, before, after, words):
    objections = judged(tuned, before, after).objections
    assert len(objections) == (words is not None)
    assert all(words in line and "at 100% battery" in line for line in objections)


@pytest.mark.parametrize(
    ("after", "words"),
    [
        ((0.3, 0.049, 0.009), None),
        ((None, 0.0, 0.0), "does not settle at 100% battery"),
        ((0.3, 0.051, 0.0), "overshoots by 5.1% at 100% battery"),
        ((0.3, 0.0, -0.011), "misses the speed by -1.1% at 100% battery"),
    ],
)
def test_what_is_not_good_is_named_even_where_it_is_better_than_before(tuned, after, words):
    assert judged(tuned, after, after).shortcomings == ([words] if words else [])


# Fits, against plants of which all is known


@pytest.mark.parametrize("delay_s", [0.01, 0.03])
@pytest.mark.parametrize("hysteresis", [0.1, 0.7])
def test_the_relay_shows_time_constant_and_dead_time(delay_s, hysteresis):
    gain, tau_s, dt_s = 2.2, 0.08, 1e-4
    relay = Relay(1.5, hysteresis)
    late = [relay.amplitude] * round(delay_s / dt_s)
    speed, speeds = 0.0, []
    for _ in range(30_000):
        late.append(relay.step(0.0, speed))
        speed += (gain * late.pop(0) - speed) / tau_s * dt_s
        speeds.append(speed)
    oscillation = measure_oscillation(np.arange(30_000) * dt_s, speeds)
    model = relay_model(gain, relay, oscillation)
    assert model.time_constant_s == pytest.approx(tau_s, rel=0.02)
    assert model.delay_s == pytest.approx(delay_s, rel=0.04)


def test_a_swing_beyond_what_the_motor_can_is_refused():
    oscillation = dataclasses.replace(
        measure_oscillation(np.arange(4000) * 1e-3, np.sin(np.arange(4000) * 0.05)), amplitude=9.0
    )
    with pytest.raises(ValueError, match="allowed"):
        relay_model(2.0, Relay(1.0), oscillation)


@pytest.mark.parametrize("tau_s", [0.01, 0.04, 0.08, 0.2, 1.0])
@pytest.mark.parametrize("dt_s", [0.001, 0.005, 0.01])
def test_the_loop_stays_robust_at_the_longest_dead_time(tau_s, dt_s):
    model = FirstOrderModel(2.2, tau_s, 0.01)
    gains = step_gains(model, dt_s)
    s = 1j * np.geomspace(0.1, 2000.0, 20_000)
    for delay_s in (0.01, longest_delay_s(dt_s)):
        loop = (gains.kp + gains.ki / s) * model.gain * np.exp(-delay_s * s) / (tau_s * s + 1.0)
        assert np.max(1.0 / np.abs(1.0 + loop)) < 2.2
    assert gains.kp / gains.ki >= 4.0 * longest_delay_s(dt_s) - 1e-12


def test_figures_are_rounded_to_significant_ones():
    assert round_figures(0.0123456, 3) == 0.0123
    assert round_figures(-1234.5, 2) == -1200.0
    assert round_figures(0.0, 3) == 0.0


# The patch


def merged(text, patch):
    """The robot's file with the values of the patch in place of its own."""
    table = ""
    lines = []
    for original in text.splitlines():
        line = original
        if header := re.match(r"\s*\[+\s*([\w.]+)", line):
            table = header[1]
        wheel = table.removeprefix("control.")
        assignment = re.match(r"(\w+)\s*=", line)
        if assignment and assignment[1] in patch.get(wheel, {}) and table.startswith("control."):
            line = f"{assignment[1]} = {patch[wheel][assignment[1]]!r}"
        lines.append(line)
    return "\n".join(lines)


def test_the_patch_in_the_robots_file_gives_the_figures_it_promises(tuned, tmp_path):
    patch = tomllib.loads(tuned.patch())
    assert set(patch) == {"control"}
    assert {name: set(table) for name, table in patch["control"].items()} == {
        wheel: {"kp", "ki", "kd", "kv", "ks", "ka"} for wheel in ("left", "right")
    }
    path = tmp_path / "diff_drive.toml"
    path.write_text(merged(find_file("diff_drive").read_text(), patch["control"]))
    config = load_robot(path)
    assert (config.control.left, config.control.right) == tuple(tuned.gains.values())
    again = responses(TuneOptions(path), config)
    assert [response.metrics for response in again] == [r.metrics for r in tuned.after]


def test_the_patch_says_where_it_comes_from(tuned):
    comments = [line for line in tuned.patch().splitlines() if line.startswith("#")]
    text = "\n".join(comments)
    for words in ("diff_drive.toml", "--method step", "--seed 1", "--set control.left.kv=0.2"):
        assert words in text
    assert re.search(r"after, 70% battery.*settling 0\.2\d\d s", text)


def test_one_wheel_alone_can_be_tuned_and_the_same_seed_gives_the_same(tuned):
    result = tune(dataclasses.replace(tuned.options, wheel="right"))
    assert [r.metrics for r in result.before] == [r.metrics for r in tuned.before]
    assert list(result.gains) == ["right"]
    assert result.gains["right"] == tuned.gains["right"]
    assert list(tomllib.loads(result.patch())["control"]) == ["right"]


# The command


def test_the_command_prints_tables_and_writes_patch_and_plot(capsys, tmp_path):
    plot, out = tmp_path / "plot.png", tmp_path / "patch.toml"
    status = run("--robot", "tricycle", "--plot", plot, "--out", out)
    assert status == 0
    assert plot.read_bytes().startswith(b"\x89PNG")
    patch = tomllib.loads(out.read_text())["control"]["drive"]
    printed = capsys.readouterr()
    for words in ("rise time", "overshoot", "settling time", "steady-state error", "dead time"):
        assert words in printed.out
    assert f"--set control.drive.kp={patch['kp']}" in printed.out
    assert "[control.drive]" in printed.out
    assert "step experiment" in printed.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--robot", "trycycle"), 'did you mean "tricycle"'),
        (("--wheel", "lefft"), 'did you mean "left"'),
        (("--robot", "tricycle", "--wheel", "left"), "allowed: all, drive"),
        (("--method", "rely"), 'did you mean "relay"'),
        (("--plot", "plot.jpeg"), ".png"),
        (("--out", "no/such/folder/patch.toml"), "does not exist"),
        (("--out", "/"), "is a folder"),
        (("--set", "control.left.kpp=1"), 'did you mean "kp"'),
        (("--set", "simulation.mass_kg=-1"), "simulation.mass_kg"),
        (("--set", "simulation.body=[[3,3],[-3,3],[-3,-3],[3,-3]]"), "cannot stand"),
    ],
)
def test_bad_input_ends_with_status_2_and_the_nearest_name(capsys, arguments, words):
    assert run(*arguments) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("simulation.motor.air_c=119.95", "over temperature"),
        ("simulation.battery.voltage_scale=0.8", "battery is low"),
        ("simulation.errors.wheel_radius=[0.0, 0.2]", "not enough room: the robot hit a wall"),
        ("simulation.motor.coulomb_n_m=1.0", "wheel is blocked"),
        ("drive.wheel_radius_m=0.01", "at a duty of 1.00 the wheels turn at"),
    ],
)
def test_an_experiment_that_is_stopped_says_why_with_status_1(capsys, setting, words):
    assert run("--set", setting) == 1
    assert words in capsys.readouterr().err


def test_a_file_that_cannot_be_written_is_an_error_not_a_traceback(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot be written: .*directory"):
        write_file(tmp_path, lambda file: file.write_text(""))


def test_gains_that_make_it_worse_are_not_recommended(monkeypatch, capsys, tmp_path, tuned):
    wild = PidGains(0.1, 60.0)
    fits = {name: dataclasses.replace(fit, gains=wild) for name, fit in tuned.fits.items()}
    monkeypatch.setattr(tuning, "identify", lambda *_: fits)
    out = tmp_path / "patch.toml"
    assert run("--out", out) == 3
    assert not out.exists()
    printed = capsys.readouterr().out
    assert "worse" in printed
    assert "overshoots by" in printed


def test_a_robot_that_no_gains_make_good_is_named(monkeypatch, capsys, tuned):
    monkeypatch.setattr(tuning, "identify", lambda *_: tuned.fits)
    assert run("--set", "drive.wheel_radius_m=0.5") == 0
    printed = capsys.readouterr().out
    assert "beware: even with the new gains the robot does not settle at 100% battery" in printed


def test_without_matplotlib_the_command_says_what_to_install(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(files.importlib.util, "find_spec", lambda _name: None)
    assert run("--plot", tmp_path / "plot.png") == 2
    said = capsys.readouterr().err
    (command,) = (line.strip() for line in said.splitlines() if "pip install" in line)
    assert command in (Path(__file__).parents[3] / "docs" / "deploy.md").read_text("utf-8")


def test_an_unknown_wheel_is_refused_before_anything_moves():
    with pytest.raises(ConfigError, match="no such wheel"):
        tune(TuneOptions(find_file("ackermann"), wheel="right"))


def test_a_fit_keeps_what_the_wheels_table_else_holds(tuned):
    overrides = ("control.left.tracking_s=0.2", "control.left.kd=0.01")
    config = load_robot(find_file("diff_drive"), overrides)
    fit: WheelFit = tuned.fits["left"]
    gains = tuning.new_gains(config, "left", fit)
    assert gains.tracking_s == 0.2
    assert gains.kd == 0.0
