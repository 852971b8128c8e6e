"""What doctor advises for each problem that a node can have, in the words of its commissioning."""

import pytest

from robotctl.app.processes.robot import make_codec
from robotctl.deploy.check_result import Verdict
from robotctl.deploy.doctor_nodes import check_node
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.nodes.commissioning import REVISION_MAJOR, VENDOR_ID
from robotctl.drivers.can.nodes.drive import PRODUCT, drive_script
from robotctl.drivers.can.nodes.sdo import ABORT_NO_OBJECT, SdoResponse
from robotctl.messages.control import NodeStatus

DBC = make_codec().dbc
PARAMETERS = NodeParameters(200, 90, 350, 2400, False, 8)
GOOD = tuple(
    SdoResponse(value)
    for value in (VENDOR_ID, PRODUCT, REVISION_MAJOR << 16, DBC.wire_version, 2400)
)
NO_ANSWER, NO_OBJECT, REFUSED = (
    SdoResponse(),
    SdoResponse(abort=ABORT_NO_OBJECT),
    SdoResponse(abort=1),
)


def problem(good: int, last: SdoResponse) -> str:
    """What the commissioning of the drive says after so many good answers and another one."""
    script = drive_script(DBC, PARAMETERS)()
    next(script)
    for answer in GOOD[:good]:
        script.send(answer)
    with pytest.raises(StopIteration) as end:
        script.send(last)
    return f"drive (node 1): {end.value.value}"


FIXES = {
    problem(0, NO_ANSWER): "check its power and cable",
    problem(2, NO_ANSWER): "check its power and cable",
    problem(3, NO_ANSWER): "check its power and cable",
    problem(5, NO_ANSWER): "check its power and cable",
    problem(0, SdoResponse(1)): "give each node its own number",
    problem(1, SdoResponse(2)): "give each node its own number",
    problem(2, SdoResponse(0)): "load the firmware",
    problem(3, SdoResponse(0)): "load the firmware",
    problem(3, NO_OBJECT): "load the firmware",
    problem(4, REFUSED): "load the firmware",
    problem(4, SdoResponse(2000)): "correct the robot's file",
    problem(5, REFUSED): "correct the robot's file",
    problem(5, NO_OBJECT): "load the firmware",
    "drive (node 1): not heard on the bus": "check its power and cable",
    "drive (node 1): no heartbeat for 350 ms": "check its power and cable",
}


@pytest.mark.parametrize("said", FIXES)
def test_each_problem_of_a_node_has_the_advice_that_mends_it(said: str) -> None:
    finding = check_node(NodeStatus(1, "drive", 5, 0, 1, said), DBC.wire_version)
    assert finding.verdict is Verdict.FAIL
    assert finding.found == said
    assert finding.fix.startswith(FIXES[said])


def test_a_node_in_service_has_nothing_to_mend() -> None:
    finding = check_node(NodeStatus(1, "drive", 5, 0, 1, ""), DBC.wire_version)
    assert finding.verdict is Verdict.OK
    assert not finding.fix
