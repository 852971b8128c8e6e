"""Recordings as CSV: pandas reads in them what the messages say."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.logs.mcap.entries import Published
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.table import header_of, rows_of, unit_of
from robotctl.messages.control import Notice
from robotctl.runtime.flight.recorder import LENGTH
from robotctl.workbench.logs.export import Exported, export_csv
from robotctl.workbench.logs.rows import RecordingError, Survey
from tests.app.simulation.missions import PATROL
from tests.cli.command import status_of
from tests.mavlink.conftest import CONTROL

EPOCH_NS = 1_700_000_000_000_000_000


def exported(run: Path, folder: Path) -> Exported:
    return export_csv(run, folder, lambda done, total: None)


def write_log(path: Path, *messages: Published) -> None:
    with path.open("wb") as file:
        log = McapLog(file, EPOCH_NS, "rover")
        for message in messages:
            log.add(message)
        log.close()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded run with a localiser, in several files."""
    folder = tmp_path_factory.mktemp("run")
    run_lockstep(
        SimOptions(
            find_file("diff_drive"),
            PATROL,
            record=folder,
            max_seconds=12.0,
            localisation=('localisation.method="mcl"',),
            overrides=("log.file_mb=0.2", "log.total_mb=100"),
        )
    )
    assert len(list(folder.glob("robot-*.mcap"))) > 1
    return folder


@pytest.fixture(scope="module")
def tables(run: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, pd.DataFrame]:
    folder = tmp_path_factory.mktemp("csv") / "made" / "here"
    files = exported(run, folder).files
    tables = {each.path.stem: pd.read_csv(each.path) for each in files}
    assert {each.path.stem: (each.rows, each.columns) for each in files} == {
        topic: table.shape for topic, table in tables.items()
    }
    return tables


def messages(run: Path, topic: str) -> list[tuple[int, dict[str, Any]]]:
    found = []
    for path in sorted(run.glob("robot-*.mcap")):
        with path.open("rb") as file:
            for _, _, message in make_reader(file).iter_messages(topic, log_time_order=False):
                found.append((message.log_time, json.loads(message.data)))
    return found


def test_each_topic_is_a_table_with_a_row_for_each_message(
    run: Path, tables: dict[str, pd.DataFrame]
) -> None:
    assert {"control", "navigation", "localisation", "lidar", "T_world_base", "map"} <= set(tables)
    for topic in set(tables) - {"particles"}:
        logged = messages(run, topic)
        np.testing.assert_allclose(tables[topic]["time_s"], [1e-9 * each for each, _ in logged])
    assert min(table["run_s"].iloc[0] for table in tables.values()) == 0.0


def test_numbers_are_those_of_the_messages_to_the_bit(
    run: Path, tables: dict[str, pd.DataFrame]
) -> None:
    control = tables["control"]
    logged = [state for _, state in messages(run, "control")]
    for column, value_of in {
        "T_odom_base.x_m": lambda state: state["T_odom_base"]["x_m"],
        "duty[1]": lambda state: state["duty"][1],
        "battery.voltage_v": lambda state: state.get("battery", {}).get("voltage_v", math.nan),
        "v_m_s": lambda state: state.get("v_m_s", math.nan),
        "state": lambda state: state["state"],
    }.items():
        np.testing.assert_array_equal(control[column], [value_of(each) for each in logged])
    assert control["reason"].dropna().isin([each["reason"] for each in logged]).all()


def test_a_missing_value_is_an_empty_cell_and_an_infinite_one_is_inf(
    run: Path, tables: dict[str, pd.DataFrame]
) -> None:
    heard = [
        sonar.get("range_m", math.inf if sonar["out_of_range"] else math.nan)
        for _, state in messages(run, "control")
        for sonar in state["sonars"]
        if sonar["name"] == "front_left"
    ]
    assert math.inf in heard
    assert any(map(math.isnan, heard))
    np.testing.assert_array_equal(tables["control"]["sonars[front_left].range_m"], heard)
    lidar = tables["lidar"]
    beams = lidar[[each for each in lidar.columns if each.startswith("ranges[")]].to_numpy()
    logged = np.array([scan["ranges"] for _, scan in messages(run, "lidar")])
    assert (logged >= 1e6).any()
    np.testing.assert_array_equal(beams, np.where(logged >= 1e6, np.inf, logged))


def test_every_column_but_texts_is_numeric_and_tells_its_unit(
    tables: dict[str, pd.DataFrame],
) -> None:
    texts = {
        column
        for table in tables.values()
        for column in table.columns
        if not pd.api.types.is_numeric_dtype(table[column])
    }
    assert texts <= {
        *("reason", "fault_part", "mission", "item_name", "message", "method", "name", "frame_id"),
        *(f"nodes[{each}].problem" for each in ("drive", "sonar", "power")),
        *(each for each in texts if each.endswith(".parent_frame_id")),
        *(each for each in texts if each.startswith("against_arming[")),
    }
    assert "pose.position.x [m]" in tables["T_world_base"].columns
    assert "ranges[0] [m]" in tables["lidar"].columns
    assert "theta [rad]" in tables["particles"].columns


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("v_m_s", "m/s"),
        ("wheel_ref_rad_s[1]", "rad/s"),
        ("T_odom_base.theta_rad", "rad"),
        ("loop.lag_us_p999", "us"),
        ("loop.lag_us_max", "us"),
        ("temperature_c[0]", "degC"),
        ("sonars[front_m].stamp_ns", "ns"),
        ("pose.orientation.x", ""),
        ("duty[0]", ""),
    ],
)
def test_a_unit_is_that_of_the_name(column: str, unit: str) -> None:
    assert unit_of(column) == unit
    assert header_of(column) == column


def test_a_unit_that_is_not_in_the_name_stands_behind_it() -> None:
    assert header_of("loop.stage_us_p50.receive") == "loop.stage_us_p50.receive [us]"
    assert header_of("transforms[base].translation.x") == "transforms[base].translation.x [m]"


def test_particles_have_a_row_for_each_point(run: Path, tables: dict[str, pd.DataFrame]) -> None:
    particles = tables["particles"]
    count = len(messages(run, "particles"))
    assert particles["time_s"].nunique() == count
    assert len(particles) > 50 * count
    begin = particles[particles["time_s"] == particles["time_s"].iloc[0]]
    assert begin["x [m]"].std() < 1.0
    assert begin["index"].tolist() == list(range(len(begin)))


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1))
def test_texts_survive_commas_quotes_and_line_ends(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    folder = tmp_path_factory.mktemp("text")
    write_log(folder / "robot-0001.mcap", Notice(0, 4, text), Notice(10, 4, "end"))
    exported(folder, folder)
    with (folder / "notice.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["message"] for row in rows] == [text, "end"]
    assert [row["time_s"] for row in rows] == [
        "1700000000.000000000",
        "1700000000.000000010",
    ]


def test_a_column_that_comes_later_stands_beside_its_neighbours(tmp_path: Path) -> None:
    stale = msgspec.structs.replace(CONTROL, wheel_rad_s=(math.nan, math.nan), battery=None)
    fresh = msgspec.structs.replace(CONTROL, stamp_ns=20_000_000, wheel_rad_s=(1.0, 2.0))
    write_log(tmp_path / "robot-0001.mcap", stale, fresh)
    exported(tmp_path, tmp_path)
    columns = list(pd.read_csv(tmp_path / "control.csv").columns)
    at = columns.index("wheel_rad_s[0]")
    assert columns[at - 1 : at + 3] == [
        "distance_m",
        "wheel_rad_s[0]",
        "wheel_rad_s[1]",
        "wheel_ref_rad_s[0]",
    ]


def test_a_record_of_the_control_loop_tells_the_same_states_as_the_log_beside_it(
    run: Path, tables: dict[str, pd.DataFrame], tmp_path: Path
) -> None:
    first = run / "control-0001.rec"
    result = exported(first, tmp_path)
    assert result.notes == ()
    states = pd.read_csv(tmp_path / "control.csv")
    both = states.merge(tables["control"], on="time_s", suffixes=("", " logged"))
    assert len(both) > 50
    for column in ("v_m_s", "T_odom_base.x_m", "state", "duty[0]", "sonars[front].range_m"):
        np.testing.assert_array_equal(both[column], both[f"{column} logged"])
    ticks = pd.read_csv(tmp_path / "tick.csv")
    assert len(ticks) == len(states)
    assert ticks["command.values[0]"].abs().max() > 0.1
    heard = pd.read_csv(tmp_path / "sonars.csv")
    assert heard["range_m[front]"].dropna().between(0.02, 4.2).any()


def test_a_record_that_was_cut_is_read_up_to_the_cut(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.rec"
    content = (run / "control-0001.rec").read_bytes()
    cut = 0
    while cut < len(content) // 2:
        cut += LENGTH.size + LENGTH.unpack_from(content, cut)[0]
    path.write_bytes(content[: cut + LENGTH.size + 1])  # between two messages it would look whole
    result = exported(path, tmp_path)
    assert any("was cut short, read up to there" in note for note in result.notes)
    assert len(pd.read_csv(tmp_path / "tick.csv")) > 20


def test_a_damaged_record_is_read_up_to_the_damage(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "damaged.rec"
    path.write_bytes((run / "control-0001.rec").read_bytes() + (8).to_bytes(4, "little") + b"x" * 8)
    result = exported(path, tmp_path)
    assert any("damaged" in note and "read up to there" in note for note in result.notes)
    whole = exported(run / "control-0001.rec", tmp_path / "whole")
    rows = {each.path.stem: each.rows for each in result.files}
    assert rows["tick"] == {each.path.stem: each.rows for each in whole.files}["tick"]


def test_a_log_that_a_kill_cut_is_read_up_to_its_last_flush(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "robot-0001.mcap"
    content = (run / path.name).read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    result = exported(path, tmp_path)
    assert any("was cut" in note for note in result.notes)
    assert {"control", "frames"} <= {each.path.stem for each in result.files}


def test_what_comes_while_a_run_goes_on_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "robot-0001.mcap"
    write_log(path, Notice(0, 4, "first"))
    short = path.read_bytes()
    write_log(path, Notice(0, 4, "first"), CONTROL)
    grown = path.read_bytes()
    path.write_bytes(short)
    survey = Survey.of([path], lambda done: None)
    path.write_bytes(grown)
    assert [topic for topic, _, _ in survey.rows_again([path])] == ["notice"]


def refusal(run: Path, folder: Path) -> str:
    with pytest.raises(RecordingError) as refused:
        exported(run, folder)
    assert not (folder / "csv").exists()
    return str(refused.value)


def test_what_is_no_recording_is_refused_with_what_is_one(run: Path, tmp_path: Path) -> None:
    needed = "needed is a folder of --record, a robot-*.mcap, or a record"
    assert needed in refusal(tmp_path / "missing", tmp_path / "csv")
    (can_log,) = list(run.glob("can-0001.log"))
    assert "can-0001.log: neither an MCAP log nor a record" in refusal(can_log, tmp_path / "csv")
    assert "no robot-*.mcap in it" in refusal(tmp_path, tmp_path / "csv")
    (tmp_path / "fault-1.rec").write_bytes(b"")
    assert f"give one of its records, such as {tmp_path / 'fault-1.rec'}" in refusal(
        tmp_path, tmp_path / "csv"
    )


def test_the_command_says_what_it_wrote_and_refuses_a_file_in_the_place_of_the_folder(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of("record", "export", run, "--csv", tmp_path / "csv") == 0
    taken = tmp_path / "csv" / "control.csv"
    before = taken.read_bytes()
    rows = before.count(b"\n") - 1
    assert f"{taken}: {rows} rows" in capsys.readouterr().out
    assert status_of("record", "export", run, "--csv", taken) == 2
    assert "is a file, a folder is needed" in capsys.readouterr().err
    assert taken.read_bytes() == before


def test_names_of_the_parts_of_a_list_that_are_no_texts_are_not_taken_for_names() -> None:
    (row,) = rows_of({"a": [{"name": "x", "v": 1}, {"v": 2}], "name": "rover"})
    assert row == {"a[x].v": 1, "a[1].v": 2, "name": "rover"}
