"""The command of docs/extending.md is listed, runs, and ends with 2 where its input is bad."""

import subprocess
import sys

from robotctl.cli.commands import COMMANDS, load


def robotctl(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "robotctl", *arguments], capture_output=True, text=True, check=False
    )


def test_it_is_listed_runs_and_refuses(tmp_path):
    assert "distance" in robotctl("--help").stdout
    path = tmp_path / "drive.txt"
    rows = ("0,0,0,0", "10000000000,3,4,0", "20000000000,3,5,0")
    path.write_text("\n".join(("stamp_ns,x_m,y_m,theta_rad", *rows, "")))
    done = robotctl("distance", str(path))
    assert (done.returncode, done.stdout, done.stderr) == (0, "6.000 m\n", "")
    bad = robotctl("distance", str(tmp_path / "drove.txt"))
    assert bad.returncode == 2
    assert 'did you mean "drive.txt"?' in bad.stderr


def test_the_table_says_what_the_command_says_of_itself():
    assert load("distance").help.splitlines()[0] == COMMANDS["distance"][1]
