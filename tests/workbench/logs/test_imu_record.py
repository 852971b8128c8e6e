"""What an IMU says is in log, record and replay, as the bus brought it."""

import json
from pathlib import Path

import can
import cantools.database
import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import config_directory, find_file
from robotctl.workbench.logs.export import export_csv
from robotctl.workbench.replay.replay import replay_file
from tests.app.simulation.missions import PATROL

GYRO, ACCELEROMETER = 0x184, 0x284


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    overrides = ("imu.enabled=true", "imu.yaw_deg=90")
    run_lockstep(
        SimOptions(
            find_file("diff_drive"), PATROL, record=folder, max_seconds=6.0, overrides=overrides
        )
    )
    return folder


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
