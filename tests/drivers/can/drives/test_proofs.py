"""A drive arms only with the settings with which it was seen to stop."""

from types import SimpleNamespace

import pytest

from robotctl.drivers.can.drives.proofs import ProvenDrive
from robotctl.messages.control import NodeStatus
from robotctl.messages.faults import FaultCode

IN_SERVICE = NodeStatus(3, "left_drive", 5, 0, 1, "")
STARTING = NodeStatus(3, "left_drive", 5, 0, 1, "is being identified", FaultCode.NODE_STARTING)


def judged(proofs, proof, status=IN_SERVICE):
    drive = SimpleNamespace(status=STARTING, proof=None)
    proven = ProvenDrive(drive, proofs)
    assert proven.status is STARTING
    drive.status, drive.proof = status, proof
    return proven.status


@pytest.mark.parametrize(
    ("proofs", "proof"), [({"left_drive": "90 ms"}, "90 ms"), ({}, ""), ({"other": "x"}, None)]
)
def test_a_drive_that_is_proven_or_needs_no_proof_is_in_service(proofs, proof):
    assert judged(proofs, proof) is IN_SERVICE


def test_a_drive_that_was_never_proven_is_out_of_service_and_says_what_to_do():
    status = judged({"right_drive": "90 ms"}, "90 ms")
    assert status.fault == FaultCode.DRIVE_UNPROVEN
    assert status.problem == (
        "left_drive (node 3): was never seen to stop when the host is silent (90 ms): wheels off "
        "the floor, then `robotctl setup prove`"
    )


def test_a_drive_whose_settings_changed_has_to_be_proven_again():
    status = judged({"left_drive": "90 ms"}, "0 ms")
    assert status.fault == FaultCode.DRIVE_UNPROVEN
    assert "other settings (90 ms) than it has (0 ms)" in status.problem


def test_another_problem_comes_first():
    assert judged({}, "90 ms", STARTING) is STARTING


def test_settings_that_change_while_it_is_in_service_are_noticed():
    drive = SimpleNamespace(status=IN_SERVICE, proof="90 ms")
    proven = ProvenDrive(drive, {"left_drive": "90 ms"})
    assert proven.status is IN_SERVICE
    drive.proof = "500 ms"
    assert proven.status.fault == FaultCode.DRIVE_UNPROVEN
