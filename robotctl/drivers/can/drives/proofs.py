"""Proofs that drives stop when the host falls silent: which are needed, and which are missing.

`robotctl setup` sees each drive stop on blocks, and writes its settings of that moment into the
table `[proof]` of the robot's file. A drive whose settings are others now has not been proven.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from robotctl.drivers.can.drives.motor_drive import MotorDrive
from robotctl.messages.control import NodeStatus
from robotctl.messages.faults import FaultCode


class ProvenDrive:
    """The status of a drive, out of service as long as it is not proven.

    Parameters
    ----------
    drive
        The drive.
    proofs
        Settings with which each drive was proven, by the names of the drives.
    """

    def __init__(self, drive: MotorDrive, proofs: Mapping[str, str]) -> None:
        self._drive = drive
        self._proofs = proofs
        self._judged = drive.status, drive.proof
        self._status = drive.status

    @property
    def status(self) -> NodeStatus:
        """Whether it is in service, and why not; another object only where it changed."""
        drive = self._drive
        before, proof = self._judged
        if drive.status is not before or drive.proof != proof:
            self._judged = drive.status, drive.proof
            self._status = self._judge(drive.status, drive.proof)
        return self._status

    def _judge(self, status: NodeStatus, proof: str | None) -> NodeStatus:
        """Return a drive's status; one in service that is not proven has a problem."""
        if status.problem or not proof:
            return status
        proven = self._proofs.get(status.name)
        if proven == proof:
            return status
        remedy = "wheels off the floor, then `robotctl setup prove`"
        if proven is None:
            problem = f"was never seen to stop when the host is silent ({proof}): {remedy}"
        else:
            problem = f"was proven with other settings ({proven}) than it has ({proof}): {remedy}"
        return msgspec.structs.replace(
            status,
            problem=f"{status.name} (node {status.node_id}): {problem}",
            fault=FaultCode.DRIVE_UNPROVEN,
        )
