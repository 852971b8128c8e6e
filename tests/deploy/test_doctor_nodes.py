"""What doctor advises for each problem of a node, by the code that its commissioning gives."""

import pytest

from robotctl.app.processes.robot import make_codec
from robotctl.config.robot_file import find_file, load_robot
from robotctl.deploy.check_result import Verdict
from robotctl.deploy.doctor_nodes import check_drives, check_node
from robotctl.drivers.can.drives.native.settings import drive_script
from robotctl.drivers.can.nodes.commissioning import REVISION_MAJOR, VENDOR_ID, Product
from robotctl.drivers.can.nodes.sdo import ABORT_NO_OBJECT, SdoResponse
from robotctl.messages.control import NodeStatus
from robotctl.messages.faults import Fault, FaultCode

DBC = make_codec().dbc
GOOD = tuple(
    SdoResponse(value)
    for value in (VENDOR_ID, Product.MOTOR_CONTROLLER, REVISION_MAJOR << 16, DBC.wire_version, 2400)
)
NO_ANSWER, NO_OBJECT, REFUSED = (
    SdoResponse(),
    SdoResponse(abort=ABORT_NO_OBJECT),
    SdoResponse(abort=1),
)


def fault(good: int, last: SdoResponse) -> Fault:
    """What the commissioning of the drive says after so many good answers and another one."""
    script = drive_script(DBC, 200, 90, 2400, steered=False)()
    next(script)
    for answer in GOOD[:good]:
        script.send(answer)
    with pytest.raises(StopIteration) as end:
        script.send(last)
    return end.value.value


C = FaultCode
FIXES = [
    (fault(0, NO_ANSWER), C.NODE_NO_ANSWER, "check its power and cable"),
    (fault(2, NO_ANSWER), C.NODE_NO_ANSWER, "check its power and cable"),
    (fault(3, NO_ANSWER), C.NODE_NO_ANSWER, "check its power and cable"),
    (fault(5, NO_ANSWER), C.NODE_NO_ANSWER, "check its power and cable"),
    (fault(0, SdoResponse(1)), C.NODE_OTHER_DEVICE, "give each node its own number"),
    (fault(1, SdoResponse(2)), C.NODE_OTHER_DEVICE, "give each node its own number"),
    (fault(2, SdoResponse(0)), C.NODE_OTHER_FIRMWARE, "load the firmware"),
    (fault(3, SdoResponse(0)), C.NODE_OTHER_FIRMWARE, "load the firmware"),
    (fault(3, NO_OBJECT), C.NODE_OTHER_FIRMWARE, "load the firmware"),
    (fault(4, REFUSED), C.NODE_OTHER_FIRMWARE, "load the firmware"),
    (fault(4, SdoResponse(2000)), C.NODE_OTHER_VALUE, "correct the robot's file"),
    (fault(5, REFUSED), C.NODE_OTHER_VALUE, "correct the robot's file"),
    (fault(5, NO_OBJECT), C.NODE_OTHER_FIRMWARE, "load the firmware"),
    (Fault(C.NODE_NOT_HEARD, "not heard"), C.NODE_NOT_HEARD, "check its power and cable"),
    (Fault(C.NODE_SILENT, "no heartbeat"), C.NODE_SILENT, "check its power and cable"),
]


@pytest.mark.parametrize(("said", "code", "fix"), FIXES)
def test_each_problem_of_a_node_has_the_advice_that_mends_it(
    said: Fault, code: FaultCode, fix: str
) -> None:
    assert said.code == code
    finding = check_node(NodeStatus(1, "drive", 5, 0, 1, said.text, code), DBC.wire_version)
    assert finding.verdict is Verdict.FAIL
    assert finding.found == said.text
    assert finding.fix.startswith(fix)


def test_a_node_in_service_has_nothing_to_mend() -> None:
    finding = check_node(NodeStatus(1, "drive", 5, 0, 1, ""), DBC.wire_version)
    assert finding.verdict is Verdict.OK
    assert not finding.fix


def test_what_a_file_accepts_of_its_drives_is_a_risk_that_is_shown() -> None:
    def verdicts(robot: str, *settings: str) -> dict[str, Verdict]:
        config = load_robot(find_file(robot), settings)
        return {finding.check: finding.verdict for finding in check_drives(config)}

    assert verdicts("diff_drive") == {"drive drive": Verdict.OK}
    assert verdicts("odrive") == {"drive left_drive": Verdict.OK, "drive right_drive": Verdict.OK}
    assert verdicts("roboteq") == {"drive motors": Verdict.RISK}
    (slow,) = check_drives(load_robot(find_file("vesc_car"), ["motor.0.accept_timeout_ms=500"]))
    assert slow.verdict is Verdict.RISK
    assert "500 ms without a command" in slow.found
