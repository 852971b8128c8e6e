"""Maps edited by hand, of a drawn building whose true poses are known, and of a real one."""

import gzip
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.errors import ConfigError
from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.saved_map import HEADING, whole_map
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.storage.record_log import packed
from robotctl.workbench.slam.applied_edits import EditError
from robotctl.workbench.slam.edit import edit_map
from robotctl.workbench.slam.scan_files import write_edited, write_scan_results
from robotctl.workbench.slam.scans import scan_slam_of
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along, scan_of
from tests.workbench.slam.test_two_sessions import FULL_CIRCLE, recording, silent

ROUND = along([(1.0, 1.0), (13.0, 1.0), (13.0, 9.0), (1.0, 9.0), (1.0, 1.0), (7.0, 1.0)])
FIRST = along([(1.0, 1.0), (13.0, 1.0), (13.0, 5.0)])
SECOND = along([(4.0, 9.0), (13.0, 9.0), (13.0, 1.0), (9.0, 1.0)])
"""It begins where the first has never been."""
FRAME = SE2(3.0, -2.0, 0.5)
"""`map` in `world` of maps that are written here, as while driving."""
BENT_RAD = 0.006
"""Turn that is added to each link of a bent map."""

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def written(folder, keyframes, poses, links):
    """Write a map of keyframes at the optimum of its links, and return its file."""
    back_end = BackEnd()
    back_end.load(poses, links, [1.0] * len(links))
    mapped = SimpleNamespace(keyframes=keyframes, images={}, back_end=back_end, epoch=0)
    folder.mkdir(exist_ok=True)
    file = folder / "map.keyframes"
    file.write_bytes(HEADING + packed([whole_map(mapped, "lidar", FRAME, (0, SE2()))]))
    return file


def edited(file, edits, folder):
    """Return the result of edits in TOML, the saved map and the report."""
    path = folder / "edits.toml"
    path.write_text(edits)
    result = edit_map(file, path, silent)
    out = folder / "out"
    out.mkdir(exist_ok=True)
    write_edited(result, out)
    return load_keyframes(out / "map.keyframes"), json.loads((out / "report.json").read_text())


def true_poses(saved, *drives):
    """Return the true pose of each keyframe of drives with a scan each 0.4 s, one by one."""
    stamps_ns = [each.stamp_ns for each in saved.keyframes]
    number = np.cumsum(np.diff(stamps_ns, prepend=0) < 0)
    return [
        drives[drive][stamp_ns // 400_000_000]
        for drive, stamp_ns in zip(number.tolist(), stamps_ns, strict=True)
    ]


def ape_m(saved, *drives):
    """Return the position error of a map of drives after alignment [m]."""
    true = np.array([(each.x_m, each.y_m) for each in true_poses(saved, *drives)])
    own = saved.poses[:, :2]
    off = moved(align(own, true), own) - true
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Map of a drive round an office, with its loop, and its file."""
    folder = tmp_path_factory.mktemp("whole")
    write_scan_results(scan_slam_of(recording(OFFICE, ROUND, 1), silent), folder)
    return load_keyframes(folder / "map.keyframes"), folder / "map.keyframes"


@pytest.fixture(scope="module")
def bent(whole, tmp_path_factory):
    """File of the map without its loop, each link of which turns too much."""
    saved, _ = whole
    turn = SE2(0.0, 0.0, BENT_RAD)
    links = [
        replace(each, pose=each.pose @ turn if each.second == each.first + 1 else each.pose)
        for each in saved.links
        if not each.is_loop and each.second == each.first + 1
    ]
    return written(tmp_path_factory.mktemp("bent"), saved.keyframes, saved.poses, links)


def closing(saved):
    """Return the loop of the last keyframe with the one a round ago that is nearest to it."""
    true = true_poses(saved, ROUND)
    first = min(range(40), key=lambda each: abs(true[each].x_m - true[-1].x_m))
    return f"[[loop]]\nkeyframe = {first}\nother = {len(true) - 1}\n"


def test_a_loop_closed_by_hand_straightens_a_bent_map(bent, tmp_path):
    before, content = load_keyframes(bent), bent.read_bytes()
    assert ape_m(before, ROUND) > 0.5
    # Where the robot was a round ago, said to half a metre and without a heading.
    after, report = edited(bent, closing(before) + "x_m = 0.5\n", tmp_path)
    assert ape_m(after, ROUND) < 0.1
    assert report["verdict"] == "good"
    assert sum(link.is_given for link in after.links) == report["given"] > 0
    assert report["linked_again"] > 20
    assert bent.read_bytes() == content


def test_a_wrong_loop_is_refused_with_its_neighbours(whole, tmp_path):
    saved, _ = whole
    wrong = [
        KeyframeLink(5 + k, 60 + k, SE2(1.0, 2.0, 0.5), 1e4 * np.eye(3), True, True)
        for k in (0, 4, 8, 13)
    ]
    file = written(tmp_path / "wrong", saved.keyframes, saved.poses, [*saved.links, *wrong])
    assert ape_m(load_keyframes(file), ROUND) > 0.5
    text = "[[refuse]]\nkeyframe = 62\nother = 7\n"
    after, report = edited(file, text, tmp_path)
    assert report["edits"] == [{"edit": "refuse[0]", "keyframe": 62, "other": 7, "links": 4}]
    assert ape_m(after, ROUND) < 0.05
    with pytest.raises(EditError, match=r"within 6 of them; the nearest is of \d+ and \d+$"):
        edited(file, "[[refuse]]\nkeyframe = 20\nother = 50\n", tmp_path)


def test_a_break_of_the_way_is_cut_and_its_sides_are_put_together(whole, tmp_path):
    saved, _ = whole
    before, last = 50, len(saved.keyframes) - 1
    links = [
        replace(each, pose=SE2(3.0, 1.0, 0.8) @ each.pose)
        if each.first < before <= each.second
        else each
        for each in saved.links
        if not each.is_loop
    ]
    file = written(tmp_path / "carried", saved.keyframes, saved.poses, links)
    assert ape_m(load_keyframes(file), ROUND) > 0.5
    cut = f"[[cut]]\nbefore = {before}\n"
    with pytest.raises(
        EditError, match=rf"keyframes from {before} to {last} are linked to nothing"
    ):
        edited(file, cut, tmp_path)
    after, _ = edited(file, cut + closing(saved), tmp_path)
    assert ape_m(after, ROUND) < 0.1


def test_keyframes_at_surveyed_places_turn_the_map_into_world(bent, tmp_path):
    before = load_keyframes(bent)
    true = true_poses(before, ROUND)
    text = "".join(
        f"[[move]]\nkeyframe = {each}\nx_m = {true[each].x_m}\ny_m = {true[each].y_m}\n"
        f"heading_deg = {np.degrees(true[each].theta_rad)}\n"
        for each in (0, 30, 60, 90, len(true) - 1)
    )
    after, report = edited(bent, text, tmp_path)
    off = after.poses[:, :2] - np.array([(each.x_m, each.y_m) for each in true])
    assert np.hypot(*off.T).max() < 0.2
    assert report["edits"][1]["off_m"] > 0.1
    assert after.frame == SE2()


def test_a_pose_that_the_scans_do_not_allow_is_a_reason_to_doubt(whole, tmp_path):
    saved, file = whole
    x, y, theta = saved.poses[60].tolist()
    text = (
        f"[[move]]\nkeyframe = 60\nx_m = {x + 2.0}\ny_m = {y}\n"
        f"heading_deg = {np.degrees(theta)}\nsigma_m = 0.1\n"
    )
    _, report = edited(file, text, tmp_path)
    assert report["verdict"] == "doubtful"
    assert "scans contradict move[0]: they hold keyframe 60" in report["reasons"][0]


def test_dropped_keyframes_leave_the_others_where_they_were(whole, tmp_path):
    saved, file = whole
    after, report = edited(
        file, "[[drop]]\nfirst = 40\nlast = 52\n[[drop]]\nfirst = 0\nlast = 1\n", tmp_path
    )
    kept = [each for each in range(2, len(saved.keyframes)) if not 40 <= each <= 52]
    assert report["keyframes"] == len(kept) == len(after.keyframes)
    assert [each.stamp_ns for each in after.keyframes] == [
        saved.keyframes[each].stamp_ns for each in kept
    ]
    assert np.abs(after.poses - saved.poses[kept])[:, :2].max() < 0.05
    # Nothing but the links of those left out held both sides of the gap.
    assert after.place[0] == kept.index(saved.place[0])


def test_a_gap_is_bridged_by_what_the_links_said(whole, tmp_path):
    """Two links in a row say as much as their product, with the sum of their doubts."""
    saved, _ = whole
    steps = [
        KeyframeLink(0, 1, SE2(1.0, 0.0, 0.5), np.diag([100.0, 400.0, 2500.0])),
        KeyframeLink(1, 2, SE2(2.0, 0.0, -0.1), np.diag([100.0, 400.0, 2500.0])),
    ]
    file = written(tmp_path / "three", saved.keyframes[:3], saved.poses[:3], steps)
    after, _ = edited(file, "[[drop]]\nfirst = 1\nlast = 1\n", tmp_path)
    (link,) = after.links
    begin = FRAME @ SE2(*saved.poses[0].tolist())
    ends = [begin, begin @ link.pose]
    assert after.frame == SE2()  # keyframes are in `world` then
    assert after.poses == pytest.approx(
        np.array([(each.x_m, each.y_m, each.theta_rad) for each in ends]), abs=1e-6
    )
    assert link.pose.log() == pytest.approx((steps[0].pose @ steps[1].pose).log(), abs=1e-9)
    rng = np.random.default_rng(0)
    sigmas = 1e-3 / np.sqrt([100.0, 400.0, 2500.0])
    offs = [
        (
            link.pose.inverse()
            @ steps[0].pose
            @ SE2.exp(*(sigmas * rng.standard_normal(3)).tolist())
            @ steps[1].pose
            @ SE2.exp(*(sigmas * rng.standard_normal(3)).tolist())
        ).log()
        for _ in range(20_000)
    ]
    wanted = 1e6 * np.cov(np.array(offs).T)
    assert np.linalg.inv(link.information) == pytest.approx(wanted, rel=0.05, abs=2e-4)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory):
    """Folder of the maps of two drives, each with an origin of its own."""
    folder = tmp_path_factory.mktemp("sessions")
    for name, drive, seed in (("first", FIRST, 1), ("second", SECOND, 2)):
        (folder / name).mkdir()
        write_scan_results(scan_slam_of(recording(OFFICE, drive, seed), silent), folder / name)
    return folder


def relation(sessions, first_at, second_at):
    """Return two keyframes near two poses of the drives, and the true pose of one in the other."""
    ends = []
    for name, drive, at in (("first", FIRST, first_at), ("second", SECOND, second_at)):
        saved = load_keyframes(sessions / name / "map.keyframes")
        true = true_poses(saved, drive)
        number = min(
            range(len(true)), key=lambda k: np.hypot(true[k].x_m - at[0], true[k].y_m - at[1])
        )
        ends.append((number, true[number]))
    (first, a), (other, b) = ends
    return first, other, a.inverse() @ b


@pytest.mark.parametrize("exact", [False, True])
def test_two_drives_become_one_map_by_a_relation(sessions, tmp_path, exact):
    first, other, pose = relation(sessions, (13.0, 3.0), (13.0, 4.0))
    more = f"heading_deg = {np.degrees(pose.theta_rad)}\nexact = true\n" if exact else ""
    shift = 0.0 if exact else 0.7
    after, report = edited(
        sessions / "first" / "map.keyframes",
        f'[[join]]\nmap = "{sessions / "second" / "map.keyframes"}"\nkeyframe = {first}\n'
        f"other = {other}\nx_m = {pose.x_m + shift}\ny_m = {pose.y_m}\n{more}",
        tmp_path,
    )
    assert ape_m(after, FIRST, SECOND) < 0.06
    assert report["verdict"] == "good"
    assert report["edits"][0]["off_m"] == pytest.approx(shift, abs=0.1)
    count = len(load_keyframes(sessions / "second" / "map.keyframes").keyframes)
    rows = (tmp_path / "out" / "keyframes.csv").read_text().splitlines()
    assert len(rows) == len(after.keyframes) + 1
    assert rows[-1].split(",")[2] == str(count - 1)


def test_two_drives_put_together_wrongly_are_no_good_map(sessions, tmp_path):
    """Nobody checks the relation: the second drive is turned round where it meets the first."""
    first, other, pose = relation(sessions, (13.0, 3.0), (13.0, 4.0))
    turned = pose @ SE2(0.0, 0.0, np.pi)
    _, report = edited(
        sessions / "first" / "map.keyframes",
        f'[[join]]\nmap = "{sessions / "second" / "map.keyframes"}"\nkeyframe = {first}\n'
        f"other = {other}\nx_m = {turned.x_m}\ny_m = {turned.y_m}\n"
        f"heading_deg = {np.degrees(turned.theta_rad)}\nexact = true\nunchecked = true\n",
        tmp_path,
    )
    assert report["verdict"] != "good"
    assert any("contradict what was seen there before" in each for each in report["reasons"])


def test_a_loop_whose_scans_do_not_overlap_counts_only_if_said_so(whole, tmp_path):
    saved, file = whole
    true = true_poses(saved, ROUND)
    pose = true[0].inverse() @ true[60]  # from one corner of the office to the opposite
    text = (
        f"[[loop]]\nkeyframe = 0\nother = 60\nx_m = {pose.x_m}\ny_m = {pose.y_m}\n"
        f"heading_deg = {np.degrees(pose.theta_rad)}\nexact = true\n"
    )
    with pytest.raises(EditError, match=r"loop\[0\]: keyframes 0 and 60: the scans .*overlap"):
        edited(file, text, tmp_path)
    after, report = edited(file, f"{text}unchecked = true\n", tmp_path)
    assert report["edits"][0]["overlap"] < 0.25
    assert ape_m(after, ROUND) < 0.05


def test_a_place_at_the_edge_of_the_window_may_lie_beyond(whole, tmp_path):
    """Along a corridor the scans fit the better the nearer they come."""
    saved, file = whole
    x_m = np.array([each.x_m for each in true_poses(saved, ROUND)])
    first = int(np.argmin(np.abs(x_m[:40] - x_m[-1] - 2.6)))
    with pytest.raises(EditError, match=r"at the edge of the 2 m"):
        edited(file, f"[[loop]]\nkeyframe = {first}\nother = {len(x_m) - 1}\n", tmp_path)


def test_a_loop_that_is_wrong_is_told_how_badly_the_scans_fit(whole, tmp_path):
    _, file = whole
    with pytest.raises(EditError, match=r"keyframes 3 and 60: the scans (do not )?fit"):
        edited(file, "[[loop]]\nkeyframe = 3\nother = 60\n", tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[loop]]\nkeyframe = 3\nother = 900\n", r"toml:3: loop\[0\].other: 900 found, 0 to \d+"),
        ("[[move]]\nkeyframe = -1\nx_m = 0\ny_m = 0\nheading_deg = 0\n", r"-1 found.*nearest is 0"),
        ("[[loop]]\nkeyframe = 3\nother = 3\n", r"loop\[0\].other: 3 found, another than keyframe"),
        ("[[loop]]\nkeyframe = 3\nother = 4\nexact = true\n", r"exact: .* only with a heading_deg"),
        ("[[loop]]\nkeyframe = 3\nother = 4\nunchecked = true\n", r"only with exact = true"),
        ("[[lop]]\nkeyframe = 3\n", r'lop: unknown key; did you mean "loop"'),
        ("[[drop]]\nfirst = 9\nlast = 3\n", r"drop\[0\].last: 3 found, 9 or more allowed"),
        (
            "[[drop]]\nfirst = 0\nlast = 3\n[[cut]]\nbefore = 2\n",
            r"2 found, which drop\[0\] leaves",
        ),
        ("[[cut]]\nbefore = 0\n", r"cut\[0\].before: 0 found, 1 to \d+ allowed"),
        ('[[join]]\nmap = "x.keyframes"\nkeyframe = 0\nother = 0\n', r"x.keyframes: no such file"),
    ],
)
def test_a_wrong_file_says_where_and_what_is_allowed(whole, tmp_path, text, said):
    _, file = whole
    with pytest.raises(ConfigError, match=said):
        edited(file, text, tmp_path)


def test_a_robot_drives_on_the_edited_map(bent, tmp_path):
    """A live mapper goes on with it, and links that a person gave keep their weight."""
    after, _ = edited(bent, closing(load_keyframes(bent)), tmp_path)
    mapper, rng = SlamMapper(KeyframeConfig(is_live=True)), np.random.default_rng(7)
    mapper.resume(after, is_there=False)
    start, poses = ROUND[30], ROUND[30:75]
    for number, pose in enumerate(poses):
        stamp_ns = 10**12 + number * 400_000_000
        scan = scan_of(OFFICE, pose, rng, stamp_ns=stamp_ns, angles=FULL_CIRCLE)
        mapper.add(scan, start.inverse() @ pose)
        for _ in range(20):
            mapper.relocalise()
    assert mapper.is_sure
    true = true_poses(after, ROUND)
    motion = align(after.poses[:, :2], np.array([(each.x_m, each.y_m) for each in true]))
    off = (motion @ mapper.pose).inverse() @ poses[-1]
    assert np.hypot(off.x_m, off.y_m) < 0.1


def run(*words):
    return CliRunner().invoke(app, ["slam", "edit", *map(str, words)])


def test_the_command_writes_a_new_map_and_leaves_the_old_one(whole, tmp_path):
    _, file = whole
    content = file.read_bytes()
    result = run("--map", file, "--out", tmp_path / "out", "--plot", tmp_path / "plot.png")
    assert result.exit_code == 0, result.output
    assert "0 edits" in result.output
    assert (tmp_path / "plot.png").stat().st_size > 1000
    names = {each.name for each in (tmp_path / "out").iterdir()}
    assert names == {
        "map.yaml", "map.pgm", "map.keyframes", "graph.g2o", "keyframes.csv", "report.json",
    }  # fmt: skip
    assert np.array_equal(
        load_keyframes(tmp_path / "out" / "map.keyframes").poses, load_keyframes(file).poses
    )
    refused = run("--map", file, "--out", file.parent)
    assert isinstance(refused.exception, ConfigError)
    assert "would overwrite --map" in str(refused.exception)
    assert file.read_bytes() == content


@pytest.mark.recordings("carmen/fhw-odometry.log.gz")
def test_two_halves_of_a_real_log_are_joined_by_one_rough_relation(recordings, tmp_path):
    """The relation is that of the corrected log, rounded to 0.5 m and without a heading."""
    log = recordings / "carmen" / "fhw-odometry.log.gz"
    with gzip.open(log, "rt") as file:
        lines = file.readlines()
    scans = [row for row, line in enumerate(lines) if line.startswith("FLASER")]
    half = scans[len(scans) // 2]
    reference = read_recording(log).reference
    saved = []
    for name, part in (("a", lines[:half]), ("b", lines[: scans[0]] + lines[half:])):
        path = tmp_path / f"{name}.log"
        path.write_text("".join(part))
        (tmp_path / name).mkdir()
        write_scan_results(scan_slam_of(read_recording(path), silent), tmp_path / name)
        saved.append(load_keyframes(tmp_path / name / "map.keyframes"))
    first, other = 174, 188
    a, b = (
        reference.at(each.keyframes[number].stamp_ns)
        for each, number in zip(saved, (first, other), strict=True)
    )
    pose = a.inverse() @ b
    text = (
        f'[[join]]\nmap = "b/map.keyframes"\nkeyframe = {first}\nother = {other}\n'
        f"x_m = {round(2.0 * pose.x_m) / 2.0}\ny_m = {round(2.0 * pose.y_m) / 2.0}\n"
    )
    after, report = edited(tmp_path / "a" / "map.keyframes", text, tmp_path)
    true = np.array([(at.x_m, at.y_m) for at in map(reference.at, stamps_of(after))])
    own = after.poses[:, :2]
    off = moved(align(own, true), own) - true
    # The whole log in one run: 0.149 m.
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.17
    assert report["verdict"] == "good"


def stamps_of(saved):
    return [each.stamp_ns for each in saved.keyframes]
