"""`robotctl campaign` as its user has it: real runs, killed and gone on with."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path

import pytest

from robotctl.workbench.campaign.conditions import read_report
from tests.cli.command import status_of

pytestmark = pytest.mark.timeout(600)  # each campaign is some runs, on a computer that is busy

FAILED, BAD_INPUT, INTERRUPTED = 3, 2, 130
ROBOTCTL = [sys.executable, "-c", "from robotctl.cli.main import main; main()"]
CAMPAIGN = """
missions = ["there"]
seeds = 3
max_seconds = 30
criteria = ["mission_completed = true", "time_s <= 4"]

[set]
mavlink.link = [[]]
limits.v_max_m_s = [0.3, 0.6]
"""
MISSION = """
name = "there"
world = "flat"
start = { x_m = 1.0, y_m = 1.0 }
[[item]]
kind = "drive"
waypoints = [[1.0, 1.0], [2.5, 1.0]]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "there.toml").write_text(MISSION)
    (folder / "gains.toml").write_text(CAMPAIGN)
    (folder / "many.toml").write_text(CAMPAIGN.replace("seeds = 3", "seeds = 100"))
    return folder


@pytest.fixture(scope="module")
def whole(folder):
    """The results of all runs, one at a time."""
    results = folder / "whole"
    assert status_of("campaign", folder / "gains.toml", "--results", results, "--workers", 1) == 3
    return results


def runs(results: Path) -> bytes:
    return (results / "runs.jsonl").read_bytes()


def start(file: Path, results: Path, workers: int = 2) -> "subprocess.Popen[str]":
    """Start a campaign as a process of its own, and wait for its second result."""
    command = [*ROBOTCTL, "campaign", str(file), "--results", str(results)]
    process = subprocess.Popen(
        [*command, "--workers", str(workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    deadline_s = time.monotonic() + 300.0
    while not (results / "runs.jsonl").exists() or runs(results).count(b"\n") < 2:
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    return process


def test_the_command_of_a_run_drives_it_again_to_the_byte(whole, tmp_path):
    line = json.loads(runs(whole).splitlines()[3])
    report = tmp_path / "report.json"
    subprocess.run([*ROBOTCTL, *line["words"], "--report", report], check=True, capture_output=True)
    assert read_report(report.read_bytes()) == line["report"]


def test_the_pages_say_how_many_passed_and_how_to_see_the_others_fail(folder, whole, capsys):
    assert status_of("campaign", folder / "gains.toml", "--results", whole) == FAILED
    text, _ = capsys.readouterr()
    assert "gains: 6 runs, 6 with a result" in text
    assert "passed: 3 of 6, 50 % (95 %: 18.8 to 81.2 %)" in text
    assert "Failures: 3" in text
    failed = [each for each in map(json.loads, runs(whole).splitlines()) if "=0.3" in str(each)]
    assert [each["factors"]["limits.v_max_m_s"] for each in failed] == [0.3] * 3
    page = (whole / "report.html").read_text()
    parser = HTMLParser()
    parser.feed(page)
    for each in failed:
        command = shlex.join(["robotctl", *each["words"]])
        assert command in text
        assert command.replace("'", "&#x27;") in page


def test_what_a_pass_is_may_change_without_driving_again(folder, whole, capsys):
    (folder / "laxer.toml").write_text(CAMPAIGN.replace("<= 4", "<= 40"))
    before = runs(whole)
    assert status_of("campaign", folder / "laxer.toml", "--results", whole) == 0
    assert "6 of 6" in capsys.readouterr().out
    assert runs(whole) == before


def test_a_killed_campaign_goes_on_and_its_results_are_the_same(folder, whole, tmp_path):
    process = start(folder / "gains.toml", tmp_path)
    process.kill()
    process.communicate()
    done = runs(tmp_path)
    assert b"\n" in done
    assert status_of("campaign", folder / "gains.toml", "--results", tmp_path) == FAILED
    assert runs(tmp_path) == runs(whole)


def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(folder, whole, tmp_path):
    process = start(folder / "many.toml", tmp_path)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate()
    assert process.returncode == INTERRUPTED
    assert "to go on:" in said
    assert f"robotctl campaign {folder / 'many.toml'} --results {tmp_path}" in said
    kept = runs(tmp_path).splitlines()
    assert 2 <= len(kept) < 200
    first = {each for each in kept if json.loads(each)["number"] <= 6}
    assert first
    assert first <= {*runs(whole).splitlines()}  # the same runs come first in both campaigns


def workers_below(parent: int) -> list[int]:
    """Return the processes of runs: children of the server that a campaign has started."""
    parents = {}
    for each in Path("/proc").iterdir():
        if each.name.isdigit():
            try:
                fields = (each / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            parents[int(each.name)] = int(fields[1])
    return [pid for pid, above in parents.items() if parents.get(above) == parent]


def test_a_worker_that_is_killed_costs_its_run_which_is_driven_when_going_on(
    folder, whole, tmp_path
):
    process = start(folder / "gains.toml", tmp_path, workers=1)
    while not (killed := workers_below(process.pid)):  # between two runs
        assert process.poll() is None
    os.kill(killed[0], signal.SIGKILL)
    said, _ = process.communicate()
    assert process.returncode == FAILED
    assert "6 runs, 5 with a result, 1 without" in said
    assert "its process was ended by SIGKILL" in said
    lost = json.loads(next(each for each in runs(tmp_path).splitlines() if b"SIGKILL" in each))
    rest = [each for each in runs(whole).splitlines() if json.loads(each) != lost]
    assert {*runs(tmp_path).splitlines()} - {*rest} == {
        each for each in runs(tmp_path).splitlines() if b"SIGKILL" in each
    }
    assert status_of("campaign", folder / "gains.toml", "--results", tmp_path) == FAILED
    assert runs(tmp_path) == runs(whole)


def test_bad_input_is_said_before_the_first_run(folder, tmp_path, capsys):
    (folder / "typo.toml").write_text('\nrobot = ["diff_drive"]\noptions = ["--localisr mcl"]\n')
    assert status_of("campaign", folder / "typo.toml", "--results", tmp_path / "none") == BAD_INPUT
    assert 'typo.toml:2: robot: unknown key; did you mean "robots"?' in capsys.readouterr().err
    (folder / "typo.toml").write_text('\noptions = ["--localisr mcl"]\n')
    assert status_of("campaign", folder / "typo.toml", "--results", tmp_path / "none") == BAD_INPUT
    said = capsys.readouterr().err
    assert "typo.toml:2: options[0]: No such option: --localisr" in said
    assert "--localiser" in said
    assert not (tmp_path / "none").exists()


def test_two_folders_of_the_same_runs_show_no_difference(whole, capsys):
    assert status_of("campaign", "compare", whole, whole) == 0
    text = capsys.readouterr().out
    assert "6 pairs, 0 runs without their like" in text
    assert "worse" not in text
    assert status_of("campaign", "compare", whole, whole.parent) == BAD_INPUT


def test_a_failure_is_made_small_kept_and_run_again(folder, whole, tmp_path, capsys):
    words = ("--results", whole, "--corpus", tmp_path / "corpus")
    assert status_of("campaign", folder / "gains.toml", *words) == FAILED
    text = capsys.readouterr().out
    assert "and 2 others like it: time_s = " in text
    (kept,) = (tmp_path / "corpus").glob("*.toml")
    assert "limits.v_max_m_s = [0.3]" in kept.read_text()
    assert "mavlink.link =" not in kept.read_text()
    assert status_of("campaign", "--again", tmp_path / "corpus") == FAILED
    assert "0 of 1 pass" in capsys.readouterr().out
    kept.write_text(kept.read_text().replace("time_s <= 4", "time_s <= 40"))
    assert status_of("campaign", "--again", tmp_path / "corpus") == 0
    assert "1 of 1 pass" in capsys.readouterr().out


def test_in_real_time_runs_are_on_buses_of_their_own(folder, tmp_path, capsys):
    processors = os.sched_getaffinity(0)
    buses = [f"simcan:{tmp_path}/{number}" for number in range(min(2, len(processors)))]
    (tmp_path / "there.toml").write_text(MISSION)
    file = tmp_path / "real.toml"
    text = CAMPAIGN.replace("[set]", f"buses = {json.dumps(buses)}\n\n[set]")
    file.write_text(text.replace("<= 4", ">= 4").replace("seeds = 3", "seeds = 1"))
    results = tmp_path / "results"
    assert status_of("campaign", file, "--results", results) == FAILED
    assert f"robotctl sim --headless --bus {buses[0]} " in capsys.readouterr().out
    reports = [json.loads(line)["report"] for line in runs(results).splitlines()]
    assert sorted(each["bus_kind"] for each in reports) == buses
    assert [each["mission_completed"] for each in reports] == [True, True]
    assert all(each["loop"]["lag_us"]["max"] > 0.0 for each in reports), "not in lockstep"


def test_a_bus_that_is_not_there_is_said_before_the_first_run(folder, tmp_path, capsys):
    file = folder / "none.toml"
    file.write_text(f'buses = ["vcan978"]\n{CAMPAIGN}')
    assert status_of("campaign", file, "--results", tmp_path / "never") == BAD_INPUT
    assert "vcan978" in capsys.readouterr().err
    assert not (tmp_path / "never").exists()


def test_what_contradicts_each_other_is_refused(folder, tmp_path):
    file = tmp_path / "real.toml"
    file.write_text(f'buses = ["simcan"]\nmissions = ["{folder}/there.toml"]\n')
    for word in ("--workers=2", f"--corpus={tmp_path}", "--scheduler=tcp://127.0.0.1:1"):
        assert status_of("campaign", file, word) == BAD_INPUT
    assert status_of("campaign", "--again", tmp_path) == BAD_INPUT
    file.unlink()
    assert status_of("campaign") == BAD_INPUT
    assert status_of("campaign", folder / "gains.toml", "--again", tmp_path) == BAD_INPUT
    assert status_of("campaign", "--again", tmp_path, "--results", tmp_path) == BAD_INPUT
    assert status_of("campaign", "--again", tmp_path) == BAD_INPUT


def test_what_only_a_run_can_find_out_is_found_by_a_short_one_of_each_kind(folder, capsys):
    (folder / "camera.toml").write_text(
        'robots = ["jackal"]\noptions = ["--camera --localiser mcl"]\nseeds = 1000\n'
    )
    results = folder / "never"
    assert status_of("campaign", folder / "camera.toml", "--results", results) == BAD_INPUT
    said = capsys.readouterr().err
    assert "jackal.toml: camera.mount: missing key" in said
    assert "robotctl sim --lockstep --robot jackal --camera" in said
    assert not results.exists()
