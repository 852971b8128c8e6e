"""`robotctl localise` on drives written here."""

import csv
import gzip
import json
import re

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.errors import ConfigError, RobotctlError
from robotctl.logs.formats.tum import read_tum, write_tum
from robotctl.logs.mcap.log import McapLog
from robotctl.model.trajectory import Trajectory
from robotctl.runtime.flight.recorder import Recorder, RecordHeader
from tests.cli.command import status_of
from tests.mavlink.conftest import CONTROL
from tests.workbench.localise.recorded_room import WALLS, seen, write_drive, write_map


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Folder with room.log and room.yaml, and the true poses."""
    folder = tmp_path_factory.mktemp("room")
    truth = write_drive(folder / "room.log")
    write_map(folder)
    return folder, truth


def run(folder, *arguments, log="room.log", name="a"):
    """Run the command; return its result, its report and the lines of its trajectory."""
    words = ["localise", "--log", str(folder / log), "--out", str(folder / f"{name}.tum")]
    words += ["--report", str(folder / f"{name}.json"), *arguments]
    result = CliRunner().invoke(app, words)
    if result.exit_code != 0:
        return result, None, None
    report = json.loads((folder / f"{name}.json").read_text())
    return result, report, np.loadtxt(folder / f"{name}.tum", ndmin=2)


def on_map(folder):
    return "--map", str(folder / "room.yaml")


def test_the_report_has_these_keys_and_the_trajectory_a_line_for_each_scan(room):
    folder, truth = room
    result, report, rows = run(folder, *on_map(folder))
    assert result.exit_code == 0, result.output
    assert set(report) == {
        "ape", "heading_rmse_rad", "lost", "updates", "update_ms", "particles",
        "localised_after_s", "shares", "echoes_on_map", "notes",
    }  # fmt: skip
    assert report["notes"] == []
    assert set(report["ape"]) == {"rmse_m", "mean_m", "max_m"}
    assert set(report["update_ms"]) == {"p50", "p99"}
    assert report["updates"] == len(rows) == len(truth)
    assert report["lost"] is False
    assert "place known at the end" in result.output


def test_what_the_reader_left_out_is_told_and_stands_in_the_report(room):
    folder, _ = room
    lines = (folder / "room.log").read_text().splitlines()
    (folder / "twice.log").write_text("\n".join([*lines, *lines[-2:], "SONAR 1 2 3"]) + "\n")
    result, report, rows = run(folder, *on_map(folder), log="twice.log", name="twice")
    assert len(rows) == len(lines)
    assert f"2 of {len(lines) + 2} scans repeat an earlier one, left out" in report["notes"]
    assert any("1 lines of unknown kind SONAR skipped" in note for note in report["notes"])
    for note in report["notes"]:
        assert f"note: {note}" in result.output


def test_the_errors_are_those_of_the_trajectory_to_the_logs_reference(room):
    folder, truth = room
    _, report, rows = run(folder, *on_map(folder))
    errors_m = np.hypot(*(rows[:, 1:3] - truth[:, :2]).T)
    turned = 2.0 * np.arctan2(rows[:, 6], rows[:, 7]) - truth[:, 2]
    turned = np.arctan2(np.sin(turned), np.cos(turned))
    assert report["ape"]["rmse_m"] == pytest.approx(np.sqrt(np.mean(errors_m**2)), abs=1e-5)
    assert report["ape"]["max_m"] == pytest.approx(errors_m.max(), abs=1e-5)
    assert report["heading_rmse_rad"] == pytest.approx(np.sqrt(np.mean(turned**2)), abs=1e-5)
    assert errors_m[10:].max() < 0.15
    assert rows[:, 0] == pytest.approx(100.0 + 0.5 * np.arange(len(truth)))


def test_the_same_seed_gives_the_same_file_and_another_seed_another(room):
    folder, _ = room
    for name, seed in (("one", 3), ("same", 3), ("other", 4)):
        run(folder, *on_map(folder), "--seed", str(seed), name=name)
    texts = [(folder / f"{name}.tum").read_bytes() for name in ("one", "same", "other")]
    assert texts[0] == texts[1] != texts[2]


def test_a_robots_file_says_what_its_lidar_is_like(room):
    folder, _ = room
    patched = ("--robot", "diff_drive", "--set")
    for name, words in (
        ("default", ()),
        ("robot", ("--robot", "diff_drive")),
        ("fewer", (*patched, "localisation.lidar.beams=12")),
        ("asked", ("--beams", "12")),
        ("both", (*patched, "localisation.lidar.beams=30", "--beams", "12")),
        ("coarser", (*patched, "localisation.lidar.sigma_m=0.4")),
    ):
        result, _, _ = run(folder, *on_map(folder), *words, name=name)
        assert result.exit_code == 0, result.output

    def text(name):
        return (folder / f"{name}.tum").read_bytes()

    assert text("robot") == text("default")
    assert text("fewer") == text("asked") == text("both") != text("default")
    assert text("coarser") != text("default")


def test_a_global_start_finds_the_place(room):
    folder, truth = room
    _, report, rows = run(folder, *on_map(folder), "--global", "--particles", "5000")
    assert report["lost"] is False
    assert report["localised_after_s"] > 0.0
    assert np.hypot(*(rows[-1, 1:3] - truth[-1, :2])) < 0.15
    assert report["particles"]["mean"] <= 5000


def test_odd_scans_are_those_of_odd_place(room):
    folder, _ = room
    _, report, rows = run(folder, *on_map(folder), "--scans", "odd")
    assert report["updates"] == 30
    assert rows[:3, 0] == pytest.approx([100.5, 101.5, 102.5])


def test_noise_on_the_odometry_is_survived(room):
    folder, _ = room
    arguments = ("--odometry-noise", "0.1,0.05")
    run(folder, *on_map(folder), name="quiet")
    _, report, _ = run(folder, *on_map(folder), *arguments, name="noisy")
    assert report["lost"] is False
    assert report["ape"]["rmse_m"] < 0.2
    assert (folder / "noisy.tum").read_bytes() != (folder / "quiet.tum").read_bytes()


def test_a_cut_log_is_used_up_to_the_cut_and_this_is_said(room):
    folder, truth = room
    packed = gzip.compress((folder / "room.log").read_bytes())
    (folder / "cut.log.gz").write_bytes(packed[: 2 * len(packed) // 3])
    result, report, _ = run(folder, *on_map(folder), log="cut.log.gz")
    assert result.exit_code == 0
    assert 20 < report["updates"] < len(truth)
    assert "note: " in result.output
    assert "cut short" in result.output


def write_mrclam(folder):
    """A robot on a circle among eight landmarks, in the files of MRCLAM; its velocities are off."""
    rng = np.random.default_rng(5)
    angles = np.arange(8) * np.pi / 4.0
    landmarks = np.stack([3.0 * np.cos(angles), 2.0 * np.sin(angles)], axis=1)
    t = 500.0 + 0.1 * np.arange(900)
    theta = 0.3 * (t - 500.0)
    truth = np.stack([np.sin(theta), 1.0 - np.cos(theta), theta], axis=1)
    odometry = np.stack([t, np.full(900, 0.31), np.full(900, 0.305)], axis=1)
    seen = []
    for i in range(5, 900, 3):
        for k, (dx, dy) in enumerate(landmarks - truth[i, :2]):
            bearing = np.arctan2(dy, dx) - truth[i, 2]
            bearing = np.arctan2(np.sin(bearing), np.cos(bearing))
            if abs(bearing) < 0.5:
                off_m, off_rad = rng.standard_normal(2) * (0.03, 0.01)
                seen.append((t[i], 60 + k, np.hypot(dx, dy) + off_m, bearing + off_rad))
    subjects = 6 + np.arange(8)
    still = np.zeros((8, 2))
    np.savetxt(folder / "Barcodes.dat", np.stack([subjects, subjects + 54], axis=1), "%d")
    np.savetxt(
        folder / "Landmark_Groundtruth.dat", np.column_stack([subjects, landmarks, still]), "%.6f"
    )
    np.savetxt(folder / "Robot3_Odometry.dat", odometry, "%.4f")
    np.savetxt(folder / "Robot3_Measurement.dat", np.array(seen), "%.5f")
    np.savetxt(folder / "Robot3_Groundtruth.dat", np.column_stack([t, truth]), "%.6f")


def test_landmarks_tell_the_ekf_where_the_robot_is(tmp_path):
    write_mrclam(tmp_path)
    arguments = ("--method", "ekf", "--mrclam-robot", "3")
    result, report, rows = run(tmp_path, *arguments, log="")
    assert result.exit_code == 0, result.output
    assert report["lost"] is False
    assert report["ape"]["rmse_m"] < 0.1
    assert 0.0 < report["nees_inside_95"] <= 1.0
    assert report["particles"]["mean"] == 0
    assert rows[-1, 0] == pytest.approx(589.9)
    _, noisy, _ = run(tmp_path, *arguments, "--odometry-noise", "0.1,0.1", log="")
    assert noisy["lost"] is False
    assert noisy["ape"]["rmse_m"] > report["ape"]["rmse_m"]


def test_a_drive_that_begins_before_its_reference_is_followed_from_there(tmp_path):
    write_mrclam(tmp_path)
    truth = (tmp_path / "Robot3_Groundtruth.dat").read_text().splitlines()
    (tmp_path / "Robot3_Groundtruth.dat").write_text("\n".join(truth[100:]))
    _, report, rows = run(tmp_path, "--method", "ekf", "--mrclam-robot", "3", log="")
    assert report["lost"] is False
    assert rows[0, 0] == pytest.approx(509.0, abs=0.11)


def test_a_plot_is_drawn(room):
    folder, _ = room
    result, _, _ = run(folder, *on_map(folder), "--plot", str(folder / "a.png"))
    assert result.exit_code == 0, result.output
    assert (folder / "a.png").read_bytes().startswith(b"\x89PNG")


SONARS_DEG = (0, 45, 90, -45, -90)


def write_own(folder):
    """A recording of ours: control states with sonars, the robot's sonars, the truth, a world."""
    stamps_ns = 10**9 + 100_000_000 * np.arange(150)
    theta = 0.125 * np.arange(150)
    poses = np.stack([3.0 + 0.8 * np.sin(theta), 1.8 - 0.8 * np.cos(theta), theta], axis=1)
    write_tum(folder / "truth-0001.tum", Trajectory(stamps_ns, poses))
    mounts = [{"name": f"s{deg}", "x_m": 0.0, "y_m": 0.0, "heading_deg": deg} for deg in SONARS_DEG]
    with (folder / "control-0001.rec").open("wb") as file:
        Recorder(file.write, RecordHeader("1", json.dumps({"sonar": mounts}), 0.0, 0.0, 0.0))
    with (folder / "robot-0001.mcap").open("wb") as file:
        log = McapLog(file, 0, "rover")
        for stamp_ns, (x, y, heading) in zip(stamps_ns.tolist(), poses.tolist(), strict=True):
            around = [seen(x, y, heading + np.radians(deg))[78:103] for deg in SONARS_DEG]
            log.add(
                msgspec.structs.replace(
                    CONTROL,
                    stamp_ns=stamp_ns,
                    x_m=x - 3.0,
                    y_m=y - 1.0,
                    theta_rad=heading,
                    sonar_m=tuple(float(min(cone)) for cone in around),
                    sonar_stamp_ns=(stamp_ns,) * len(SONARS_DEG),
                )
            )
        log.close()
    walls = [
        f'[[wall]]\nname = "w{i}"\npoints = [[{x1}, {y1}], [{x2}, {y2}]]\n'
        for i, (x1, y1, x2, y2) in enumerate(WALLS.tolist())
    ]
    head = '[world]\nname = "room"\nstart = { x_m = 3.0, y_m = 1.0, heading_deg = 0.0 }\n'
    (folder / "room.toml").write_text(head + "".join(walls))


@pytest.mark.parametrize("method", ["mcl", "ekf"])
def test_our_own_recording_is_localised_by_its_sonars_between_walls(tmp_path, method):
    write_own(tmp_path)
    world = str(tmp_path / "room.toml")
    result, report, rows = run(tmp_path, "--map", world, "--method", method, log="")
    assert result.exit_code == 0, result.output
    assert report["lost"] is False
    assert report["updates"] > 100
    truth = read_tum(tmp_path / "truth-0001.tum").poses
    assert np.hypot(*(rows[-1, 1:3] - truth[-1, :2])) < 0.15


@pytest.mark.recordings("lego/robot4_motors.txt")
def test_the_ekf_follows_a_real_robot_among_nameless_cylinders(recordings, tmp_path):
    out = ("--out", str(tmp_path / "a.tum"), "--report", str(tmp_path / "a.json"))
    words = ["localise", "--log", str(recordings / "lego"), "--method", "ekf", *out]
    assert CliRunner().invoke(app, words).exit_code == 0
    report = json.loads((tmp_path / "a.json").read_text())
    assert report["lost"] is False
    assert report["ape"]["rmse_m"] < 0.15
    assert report["heading_rmse_rad"] is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--method", "mcl"), "--method mcl needs --map MAP.yaml"),
        (("--method", "ekv"), 'must be one of mcl, ekf; did you mean "ekf"?'),
        (("--map", "MAP", "--scans", "od"), '--scans od: unknown; did you mean "odd"?'),
        (("--map", "MAP", "--odometry-noise", "0.1"), "--odometry-noise 0.1: two numbers with a"),
        (("--map", "MAP", "--odometry-noise", "0.1,-1"), "two finite numbers >= 0 allowed"),
        (("--method", "ekf", "--global"), "--global needs --method mcl, found ekf"),
        (("--method", "ekf"), "no sightings of landmarks in it"),
        (("--method", "ekf", "--robot", "diff_drive"), "--robot needs --method mcl, found ekf"),
        (("--map", "MAP", "--start", "1,2"), "--start 1,2: three numbers with commas"),
        (("--map", "MAP", "--start", "1,nan,2"), "--start 1,nan,2: three numbers with commas"),
        (("--map", "MAP", "--start", "1,2,3", "--global"), "--start and --global: found both"),
        (("--map", "MAP", "--reference", "MAP"), "room.yaml"),
        (("--map", "MAP", "--set", "a=1"), "--set a=1: needs --robot, whose keys it overrides"),
        (("--map", "MAP", "--robot", "dif_drive"), "diff_drive"),
        (("--map", "MAP", "--report", "/nowhere/r.json"), "the folder /nowhere does not exist"),
        (("--map", "MAP", "--plot", "a.txt"), "the suffix must be one of .png"),
    ],
)
def test_what_does_not_fit_is_refused_with_a_sentence(room, arguments, message):
    folder, _ = room
    words = [str(folder / "room.yaml") if word == "MAP" else word for word in arguments]
    result, _, _ = run(folder, *words)
    assert isinstance(result.exception, RobotctlError), result.output
    assert message in str(result.exception)


def test_a_map_without_an_obstacle_is_refused(room, tmp_path):
    folder, _ = room
    empty = write_map(tmp_path, walls=())
    result, _, _ = run(folder, "--map", str(empty))
    assert "the map has no obstacle" in str(result.exception)


def test_without_a_reference_only_a_global_start_is_possible(tmp_path):
    write_mrclam(tmp_path)
    (tmp_path / "Robot3_Groundtruth.dat").unlink()
    result, _, _ = run(tmp_path, "--method", "ekf", "--mrclam-robot", "3", log="")
    assert "no reference gives the start of the drive" in str(result.exception)


def test_a_log_without_scans_is_none_for_particles(tmp_path):
    (tmp_path / "a.log").write_text("ODOM 1 2 3 0 0 0 1.5 host 1.5\n")
    result, _, _ = run(tmp_path, "--map", str(write_map(tmp_path)), log="a.log")
    assert "no scans of use in it, which --method mcl needs" in str(result.exception)


def test_bad_input_ends_with_status_2_and_one_line(tmp_path, capsys):
    words = ("--log", tmp_path / "none.log", "--method", "ekf", "--out", tmp_path / "a.tum")
    assert status_of("localise", *words) == 2
    error = capsys.readouterr().err.splitlines()
    assert error == [f"robotctl: {tmp_path}/none.log: no such file or folder"]


def test_config_errors_are_known_to_main():
    assert issubclass(ConfigError, RobotctlError)


def test_a_start_off_the_map_is_said_and_not_only_that_the_robot_is_lost(room, tmp_path):
    folder, _ = room
    write_map(tmp_path)
    elsewhere = tmp_path / "room.yaml"
    moved = re.sub(r"origin: \[[^,]*", "origin: [5e+1", elsewhere.read_text())
    elsewhere.write_text(moved)
    for path, said in ((elsewhere, True), (folder / "room.yaml", False)):
        result, report, _ = run(folder, "--map", str(path))
        assert report["lost"] == said
        # Drawn with 0.25 m around the log's first pose.
        pattern = r"note: the start at x [-.\d]+ m, y [-.\d]+ m lies off the map, which has x 50\."
        assert bool(re.search(pattern, result.output)) == said
    searched, _, _ = run(folder, "--map", str(elsewhere), "--global", "--particles", "2000")
    assert "lies off the map" not in searched.output


def test_of_two_scans_at_one_time_the_first_that_is_used_tells_the_start(room, tmp_path):
    folder, truth = room
    lines = (folder / "room.log").read_text().splitlines()
    far = int(np.argmax(np.hypot(*(truth[:, :2] - truth[0, :2]).T)))
    assert np.hypot(*(truth[far, :2] - truth[0, :2])) > 1.0
    before = re.sub(r"\S+ host", f"{lines[0].split()[-3]} host", lines[far])
    (tmp_path / "twice.log").write_text("\n".join([before, *lines]) + "\n")
    words = ["--map", str(folder / "room.yaml"), "--scans", "odd"]
    _, report, rows = run(tmp_path, *words, log="twice.log")
    assert np.hypot(*(rows[0, 1:3] - truth[0, :2])) < 0.5
    assert report["lost"] is False


def test_a_log_without_times_is_followed_in_its_order_and_this_is_said(room, tmp_path):
    folder, truth = room
    text = re.sub(r"\S+ host", "0 host", (folder / "room.log").read_text())
    (tmp_path / "still.log").write_text(text)
    result, report, rows = run(tmp_path, *on_map(folder), log="still.log")
    assert "have one time, 0 s" in result.output.replace("\n", " ")
    assert report["lost"] is False
    assert np.hypot(*(rows[10:, 1:3] - truth[10:, :2]).T).max() < 0.2


def without_reference(folder, path):
    """Write the log of a room as it was recorded: odometry in both poses, and as ODOM lines."""
    lines = []
    for line in (folder / "room.log").read_text().splitlines():
        words = line.split()
        words[-9:-6] = words[-6:-3]
        lines.append(f"ODOM {' '.join(words[-6:-3])} 0 0 0 {words[-3]} host 0.0")
        lines.append(" ".join(words))
    path.write_text("\n".join(lines) + "\n")


def test_a_log_without_a_reference_has_null_for_errors_and_says_what_can_be_said(room, tmp_path):
    folder, truth = room
    without_reference(folder, tmp_path / "raw.log")
    result, _, _ = run(tmp_path, *on_map(folder), log="raw.log")
    assert "no reference gives the start of the drive; give --start" in str(result.exception)
    start = ("--start", "3.0,1.0,0")
    result, report, rows = run(tmp_path, *on_map(folder), *start, log="raw.log")
    assert report["ape"] == {"rmse_m": None, "mean_m": None, "max_m": None}
    assert report["heading_rmse_rad"] is None
    assert report["shares"]["confidently_wrong"] is None
    assert report["lost"] is False
    assert report["echoes_on_map"] > 0.9
    assert "no reference to compare with" in result.output
    assert np.hypot(*(rows[:, 1:3] - truth[:, :2]).T).max() < 0.2


def test_a_start_elsewhere_is_lost_without_a_reference_too(room, tmp_path):
    folder, _ = room
    without_reference(folder, tmp_path / "raw.log")
    start = ("--start", "1.0,4.0,180")
    _, report, rows = run(tmp_path, *on_map(folder), *start, log="raw.log")
    assert rows[0, 1:3] == pytest.approx([1.0, 4.0], abs=0.5)
    found = report["shares"]["localised"] < 1.0 or report["echoes_on_map"] < 0.7
    assert found, report


def test_a_tum_file_is_the_reference_that_a_log_does_not_have(room, tmp_path):
    folder, truth = room
    without_reference(folder, tmp_path / "raw.log")
    stamps_ns = 100_000_000_000 + 500_000_000 * np.arange(len(truth))
    write_tum(tmp_path / "truth.tum", Trajectory(stamps_ns, truth))
    words = ("--reference", str(tmp_path / "truth.tum"))
    _, report, rows = run(tmp_path, *on_map(folder), *words, log="raw.log")
    errors_m = np.hypot(*(rows[:, 1:3] - truth[:, :2]).T)
    assert report["ape"]["rmse_m"] == pytest.approx(np.sqrt(np.mean(errors_m**2)), abs=1e-5)
    write_tum(tmp_path / "late.tum", Trajectory(stamps_ns + 10**12, truth))
    words = ("--reference", str(tmp_path / "late.tum"))
    result, _, _ = run(tmp_path, *on_map(folder), *words, log="raw.log")
    assert "has times from 1100.000 to 1129.500 s, and raw.log from 100.000 to 129.500" in str(
        result.exception
    )


def test_the_table_has_pose_status_covariance_and_errors_of_each_estimate(room):
    folder, truth = room
    _, report, rows = run(folder, *on_map(folder), "--csv", str(folder / "a.csv"))
    with (folder / "a.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(rows) == len(truth)
    for name, column in (("t_s", 0), ("x_m", 1), ("y_m", 2)):
        assert [float(row[name]) for row in table] == pytest.approx(rows[:, column])
    assert {row["status"] for row in table} <= {"localised", "searching", "lost"}
    errors_m = np.array([float(row["error_m"]) for row in table])
    assert np.sqrt(np.mean(errors_m**2)) == pytest.approx(report["ape"]["rmse_m"], abs=1e-5)
    for row in table:
        xx, xy, yy = (float(row[key]) for key in ("var_x_m2", "cov_x_y_m2", "var_y_m2"))
        assert xx > 0.0
        assert xx * yy >= xy * xy


def test_several_seeds_give_one_table_and_each_its_own_report(room):
    folder, _ = room
    words = ("--seed", "3", "--seeds", "3")
    result, report, _ = run(folder, *on_map(folder), *words, name="three")
    assert [each["seed"] for each in report["seeds"]] == [3, 4, 5]
    assert "3 runs: place known at the end of 3" in result.output
    for each in report["seeds"]:
        _, alone, _ = run(folder, *on_map(folder), "--seed", str(each["seed"]), name="alone")
        assert alone["ape"] == each["ape"]
    run(folder, *on_map(folder), "--seed", "3", name="alone")
    assert (folder / "alone.tum").read_bytes() == (folder / "three.tum").read_bytes()


def test_no_file_need_be_written(room):
    folder, _ = room
    words = ["localise", "--log", str(folder / "room.log"), *on_map(folder)]
    assert CliRunner().invoke(app, words).exit_code == 0
