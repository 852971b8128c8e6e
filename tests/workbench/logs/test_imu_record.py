"""What an IMU says is in log, record and replay, as the bus brought it."""

import json
import math
from pathlib import Path

import can
import cantools.database
import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import config_directory, find_file, load_robot
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.logs.formats.robotctl_log import read_own
from robotctl.workbench.logs.export import export_csv
from robotctl.workbench.odometry.calibrate_sources import wheels_of
from robotctl.workbench.replay.replay import replay_file
from tests.app.simulation.missions import PATROL

GYRO, ACCELEROMETER = 0x184, 0x284


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    overrides = ("imu.enabled=true", "imu.yaw_deg=90", "simulation.errors.track_width=0.1")
    run_lockstep(
        SimOptions(
            find_file("diff_drive"), PATROL, record=folder, max_seconds=20.0, overrides=overrides
        )
    )
    return folder


def exported_counts(run: Path) -> Path:
    folder = run / "csv"
    export_csv(run / "control-0001.rec", folder, lambda done, total: None)
    return folder / "actuators.csv"


def test_a_record_holds_each_frame_of_gyro_and_accelerometer(run: Path, tmp_path: Path) -> None:
    export_csv(run / "control-0001.rec", tmp_path, lambda done, total: None)
    dbc = cantools.database.load_file(config_directory() / "robot.dbc")
    with can.LogReader(run / "can-0001.log") as log:
        frames = list(log)
    for topic, identifier, signal, column in (
        ("gyro", GYRO, "Rate", "_rad_s"),
        ("accelerometer", ACCELEROMETER, "Force", "_m_s2"),
    ):
        sent = [
            dbc.decode_message(identifier, frame.data)
            for frame in frames
            if frame.arbitration_id == identifier
        ]
        table = pd.read_csv(tmp_path / f"{topic}.csv")
        assert len(table) in (len(sent) - 2, len(sent) - 1)  # the first is a reference
        for axis in "xyz":
            told = [each[f"{signal}{axis.upper()}"] for each in sent[1 : len(table) + 1]]
            np.testing.assert_allclose(table[f"{axis}{column}"], told, atol=1e-9)


def test_a_record_with_an_imu_replays_bit_for_bit(run: Path) -> None:
    assert replay_file(run / "control-0001.rec").result.difference is None


def test_the_log_tells_attitude_and_rates_in_base(run: Path) -> None:
    with (run / "robot-0001.mcap").open("rb") as file:
        states = [
            json.loads(message.data) for _, _, message in make_reader(file).iter_messages("control")
        ]
    imus = [state["imu"] for state in states if "imu" in state]
    assert len(imus) > 100  # 20 a second
    forces = np.array([imu["force_m_s2"] for imu in imus])
    assert forces[:, 2].mean() == pytest.approx(9.8, abs=0.2)
    assert np.array([imu["up"] for imu in imus])[:, 2].min() > 0.99
    assert {"rate_rad_s", "bias_rad_s", "rise_m_s", "slip_rad"} <= imus[-1].keys()


def test_calibration_sees_the_wheels_alone(run: Path) -> None:
    """The gyro hides in the odometry what calibration looks for: how wrongly the wheels turn it."""
    recording, config = read_own(run), load_robot(find_file("diff_drive"))
    assert recording.odometry is not None
    corrected_rad = abs(recording.gyro_turns_rad[-1])
    assert corrected_rad > 0.05
    _, wheels = wheels_of(recording, OdometryModel(config.drive))
    counted = pd.read_csv(exported_counts(run))
    turns = [
        np.diff(np.unwrap(counted[name].dropna(), period=1 << 16)).sum() * math.tau / 2400
        for name in ("position_ticks[0]", "position_ticks[1]")
    ]
    assert wheels[:, :2].sum(axis=0) == pytest.approx(turns, rel=0.01)
