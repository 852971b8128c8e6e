"""docs/extending.md does what it says: applied to a copy of robotctl, each of its parts works."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.compiled_code import copied_code

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "extending.md"
CHECKS = sorted((ROOT / "tests" / "extending").glob("*.py"))
COPIED = (
    "robotctl",
    "firmware_sim",
    "native_kernels",
    "tests",
    "configs",
    "docs",
    "pyproject.toml",
)
BLOCK = re.compile(r"((?:[^\n]+\n)+)\n```(\w+)\n((?:.*\n)*?)```\n")


class Block(NamedTuple):
    """Code of the page: a whole file, or a diff of lines, and the file that it is of."""

    path: str
    kind: str
    code: str


def blocks():
    """Return the blocks of the page; the last file named in the paragraph above is that of one."""
    return [
        Block(re.findall(r"`([\w/.]+\.\w+)`", above)[-1], kind, code)
        for above, kind, code in BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    ]


def patched(text, diff):
    """Return `text` with the hunks of a diff applied; @@ stands between hunks."""
    for hunk in re.split(r"^@@\n", diff, flags=re.MULTILINE):
        lines = hunk.splitlines(keepends=True)
        old = "".join(line[1:] for line in lines if line[0] in " -")
        new = "".join(line[1:] for line in lines if line[0] in " +")
        assert text.count(old) == 1, f"not there once:\n{old}"
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """Return a folder with a copy of robotctl to which the page was applied."""
    folder = tmp_path_factory.mktemp("extended")
    ignored = shutil.ignore_patterns("compiled-*", "kernels-*", "*.png", "*.jpg")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=ignored)
        else:
            shutil.copy(ROOT / name, folder)
    for block in blocks():
        path = folder / block.path
        if block.kind == "python":
            assert not path.exists(), f"{block.path} is there already"
            path.parent.mkdir(exist_ok=True)  # a drive is a folder of its own
            path.write_text(block.code, encoding="utf-8")
        else:
            path.write_text(patched(path.read_text("utf-8"), block.code), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    return copied_code(tmp_path_factory.mktemp("code"))


def run(folder, *command, env=None):
    return subprocess.run(
        [sys.executable, "-m", *command], cwd=folder, env=env, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def ended(extended, environment):
    """Return what a run of all checks, in one process, said at its end."""
    checks = (f"tests/extending/{check.name}" for check in CHECKS)
    return run(extended, "pytest", "-q", "-rA", "-p", "no:cacheprovider", *checks, env=environment)


@pytest.mark.timeout(300)  # the first waits for all, which may compile
@pytest.mark.parametrize("check", CHECKS, ids=lambda path: path.stem)
def test_a_part_works_in_a_robotctl_to_which_the_page_was_applied(ended, check):
    outcomes = re.findall(rf"^(\w+) tests/extending/{check.name}\b", ended.stdout, re.MULTILINE)
    assert outcomes, ended.stdout + ended.stderr
    assert set(outcomes) == {"PASSED"}, ended.stdout


def test_each_part_of_the_page_has_its_check():
    headings = re.findall(r"^## An? (.+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(each.replace(" ", "_") for each in headings) == [path.stem for path in CHECKS]


def test_the_code_of_the_page_keeps_the_rules_of_the_house(extended):
    paths = [block.path for block in blocks() if block.path.endswith(".py")]
    for command in (("check",), ("format", "--check")):
        done = run(extended, "ruff", *command, "--no-cache", *paths)
        assert done.returncode == 0, done.stdout


def test_the_microservice_of_the_page_is_the_one_of_the_tests():
    (service,) = (each for each in blocks() if each.path.endswith("services/vehicle/gimbal.py"))
    member = ROOT / "tests" / "mavlink" / "services" / "gimbal.py"
    assert service.code == member.read_text(encoding="utf-8")
