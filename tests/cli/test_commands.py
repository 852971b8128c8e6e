"""The table of subcommands, and what the shell completes."""

import inspect
import os
import subprocess
import sys

import pytest

from robotctl.cli.commands import COMMANDS, OLD_NAMES, load

PROGRAM = "import sys; sys.argv[0] = 'robotctl'; from robotctl.cli.main import main; main()"
HEAVY = ("numba", "scipy", "cv2", "numpy", "zmq", "can", "pymavlink")


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_of_commands_says_what_each_says_of_itself(name: str) -> None:
    command = load(name)
    assert command.name == name
    assert inspect.cleandoc(command.help).split("\n\n")[0].replace("\n", " ") == COMMANDS[name][1]


@pytest.mark.parametrize(("old", "name"), OLD_NAMES.items())
def test_a_command_is_also_found_by_its_other_spelling(old: str, name: str) -> None:
    by_name, by_old = (
        subprocess.run(
            [sys.executable, "-m", "robotctl", word, "--help"],
            capture_output=True, text=True, check=True,
        ).stdout
        for word in (name, old)
    )  # fmt: skip
    assert f"robotctl {name}" in by_name
    assert by_old == by_name
    listed = subprocess.run(
        [sys.executable, "-m", "robotctl", "--help"], capture_output=True, text=True, check=True
    )
    assert old not in listed.stdout


HELP = ("--help", "sim --help", "tune --help", "calibrate odometry --help", "config show --help")


@pytest.mark.parametrize(
    "arguments", ["version", "--show-completion", *HELP, "can budget --help", "can scan --help"]
)
def test_nothing_heavy_is_imported_where_nothing_is_computed(arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "robotctl", *arguments.split()],
        capture_output=True, text=True, check=False, env=os.environ | {"SHELL": "/bin/bash"},
    )  # fmt: skip
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "robotctl.cli.commands" in imported
    assert not imported & set(HEAVY)


@pytest.mark.parametrize("module", ["robotctl", "robotctl.cli.main"])
def test_robotctl_runs_as_a_module(module: str) -> None:
    version = subprocess.run(
        [sys.executable, "-m", module, "version"], capture_output=True, text=True, check=False
    )
    refused = subprocess.run(
        [sys.executable, "-m", module, "config", "check", "/nowhere.toml"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (version.returncode, version.stderr) == (0, "")
    assert version.stdout.count(".") == 2
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr.startswith("robotctl: /nowhere.toml: ")


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("robotctl con", {"config"}),
        ("robotctl sim --lock", {"--lockstep"}),
        ("robotctl config ", {"check", "show", "schema"}),
        ("robotctl camera floor --sig", {"--sigma-px"}),
        ("robotctl nonsense --sig", set()),
    ],
)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shell_completes_commands_and_options(
    words: str, offered: set[str], shell: str
) -> None:
    typed = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    if shell != "bash":
        typed = {"_TYPER_COMPLETE_ARGS": words, "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=os.environ | typed | {"_ROBOTCTL_COMPLETE": f"complete_{shell}"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    said = done.stdout.replace('"', " ").replace("\t", " ").split()
    assert {word for word in said if word.startswith("-") or word in offered} >= offered
