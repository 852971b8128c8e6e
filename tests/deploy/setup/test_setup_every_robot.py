"""Each robot that comes with robotctl, wired as its file says."""

import pytest

from robotctl.config.robot_file import config_directory
from tests.deploy.setup.setup_rig import SetupRig

ROBOTS = sorted(path.stem for path in config_directory().glob("*.toml"))
UNPROVEN = {"roboteq"}
"""Its watchdog is for its maker's tool, and so for its owner."""


@pytest.mark.parametrize("robot", ROBOTS)
def test_nothing_is_changed_and_all_drives_are_proven(tmp_path, robot):
    rig = SetupRig(tmp_path, robot)
    assert rig.run("nodes", "counts", "directions") == [True, True, True]
    assert rig.text == rig.before
    assert rig.run("prove") == [robot not in UNPROVEN]
    tables = rig.tables
    proofs = tables.pop("proof", {})
    assert rig.before in rig.text
    foreign = {motor.name for motor in rig.config.motors if motor.kind != "native"}
    assert set(proofs) == (set() if robot in UNPROVEN else foreign)
