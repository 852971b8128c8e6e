"""The campaign of `make campaign`: each fault as a case that a run can have."""

from hil_tests.fault_rows import ROWS
from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.plan import plan
from tools.case_file import write_cases
from tools.own_campaign import fault_cases


def test_every_fault_after_which_a_robot_must_stop_is_a_case(tmp_path):
    cases = fault_cases(tmp_path)
    write_cases(tmp_path / "own.toml", cases)
    runs = plan(load_campaign(tmp_path / "own.toml", lambda _: ""))
    names = [run.factors["case"] for run in runs]
    assert names == ["faults that must stop it"] * len(ROWS) + ["faults to live with"] * 3
    assert "id = 385" in (tmp_path / cases[36]["faults"]).read_text()
