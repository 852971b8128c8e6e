"""The wheel, as one who installs it meets it: types for their scripts, and the command."""

import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from tests.compiled_code import copied_code

ROOT = Path(__file__).parents[2]
SCRIPT = """
from pathlib import Path

from firmware_sim.world.world import load_world
from robotctl.config.robot_file import find_file, load_robot
from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.model.geometry.se2 import SE2


def drive(robot: str, seconds: float) -> float:
    file: Path = find_file(robot)
    reveal_type(load_robot(file))
    report = run_lockstep(
        SimOptions(file, find_file("patrol", "missions"), max_seconds=seconds), print
    )
    return report.duration_s


place = SE2(1.0, 2.0, 0.5) @ SE2(0.1, 0.0, 0.0)
print(drive("diff_drive", 2.0), place.x_m, load_world(find_file("flat", "worlds")).name)
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an environment with the wheel in it, and its dependencies from ours."""
    folder = tmp_path_factory.mktemp("wheel")
    build = "import sys; from hatchling.build import build_wheel; build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, str(folder)], cwd=ROOT, check=True)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    packages = next((folder / "venv" / "lib").glob("python*/site-packages"))
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    (packages / "ours.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    return folder / "venv"


def test_types_of_a_users_script_are_checked(site: Path, tmp_path: Path) -> None:
    wrong = SCRIPT.replace("seconds)", "'two')").replace("place.x_m", "place.x")
    (tmp_path / "right.py").write_text(SCRIPT)
    (tmp_path / "wrong.py").write_text(wrong)
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "right.py", "wrong.py"]
    command += ["--python-executable", str(site / "bin" / "python"), "--cache-dir", os.devnull]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    said = done.stdout.splitlines()
    of_right = [line for line in said if line.startswith("right.py")]
    errors = [line for line in said if line.startswith("wrong.py") and ": error: " in line]
    assert len(of_right) == 1
    assert 'Revealed type is "robotctl.config.robot_file.RobotConfig"' in of_right[0]
    assert len(errors) == 2
    assert any("[arg-type]" in line for line in errors)
    assert any('"SE2" has no attribute "x"' in line for line in errors)


def test_a_users_script_runs(site: Path, tmp_path: Path) -> None:
    script = SCRIPT.replace("    reveal_type(load_robot(file))\n", "")
    (tmp_path / "script.py").write_text(script)
    done = subprocess.run(
        [site / "bin" / "python", "script.py"], cwd=tmp_path, env=copied_code(tmp_path / "code"),
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1].startswith("2.55 1.08")


@pytest.mark.parametrize("command", ["version", "config check tricycle", "can budget"])
def test_the_command_needs_no_checkout(site: Path, tmp_path: Path, command: str) -> None:
    done = subprocess.run(
        [site / "bin" / "python", "-m", "robotctl", *command.split()], cwd=tmp_path,
        env={"PATH": os.environ["PATH"]}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert str(ROOT) not in done.stdout


def test_the_page_is_in_it_as_it_is_served_without_its_source(site: Path) -> None:
    (web,) = site.glob("lib/python*/site-packages/robotctl/web")
    assert {"index.html", "page.js", "page.css"} <= {path.name for path in web.glob("static/*")}
    assert not (web / "page").exists()
