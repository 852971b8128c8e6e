import msgspec
import pytest

from robotctl.errors import ConfigError
from robotctl.workbench.campaign.campaign_file import Campaign
from robotctl.workbench.campaign.plan import plan
from robotctl.workbench.campaign.results import (
    RUNS,
    ResultFolder,
    judge,
    read_folder,
    result_of,
)
from tests.workbench.campaign.reports import head, result

RUN = plan(Campaign())[0]


def some(*numbers):
    return [result(each, True, {"seed": each}) for each in numbers]


def test_results_come_back_in_the_order_of_the_runs_however_they_came(tmp_path):
    with ResultFolder(tmp_path, head(3)) as folder:
        for each in some(3, 1, 2):
            folder.add(each)
        folder.finish([])
    assert read_folder(tmp_path) == (head(3), some(1, 2, 3))


def test_a_folder_goes_on_and_a_line_that_was_cut_short_is_driven_again(tmp_path):
    with ResultFolder(tmp_path, head(3)) as folder:
        for each in some(2, 1):
            folder.add(each)
    content = (tmp_path / RUNS).read_bytes()
    for length in range(len(content)):
        (tmp_path / RUNS).write_bytes(content[:length])
        with ResultFolder(tmp_path, head(3)) as folder:
            assert [*folder.done] == [2][: content[:length].count(b"\n")]
            for each in some(1, 2, 3):
                if each.number not in folder.done:
                    folder.add(each)
            folder.finish([])
        assert read_folder(tmp_path)[1] == some(1, 2, 3)


def test_a_run_without_a_result_is_kept_as_such_and_driven_again(tmp_path):
    lost = result(1, None, {})
    with ResultFolder(tmp_path, head(2)) as folder:
        folder.add(lost)
        folder.add(*some(2))
        folder.finish([lost])
    assert read_folder(tmp_path)[1] == [lost, *some(2)]
    with ResultFolder(tmp_path, head(2)) as folder:
        assert [*folder.done] == [2]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"fingerprint": "other"}, "of other runs"),
        ({"sources": "other"}, "of another robotctl (0.1.0)"),
    ],
)
def test_results_of_two_campaigns_are_not_mixed(tmp_path, change, said):
    with ResultFolder(tmp_path, head(1)):
        pass
    with pytest.raises(ConfigError) as refused:
        ResultFolder(tmp_path, msgspec.structs.replace(head(1), **change))
    assert said in str(refused.value)
    with ResultFolder(tmp_path, head(1, "collisions = 0")):
        pass


def test_two_campaigns_do_not_write_one_folder(tmp_path):
    with ResultFolder(tmp_path, head(1)), pytest.raises(ConfigError, match="is writing it now"):
        ResultFolder(tmp_path, head(1))


def test_a_folder_of_something_else_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no results"):
        read_folder(tmp_path)


def test_a_run_that_passes_under_a_fault_that_never_began_has_tested_nothing():
    conditions = head(1).conditions
    failed = "1.000 s: encoder_stuck failed: no such wheel"
    passed = result_of(RUN, b'{"mission_completed": true, "faults": ["1.000 s: bus"]}', "")
    assert judge(passed, conditions).passed is True
    unmet = msgspec.structs.replace(passed, report={**passed.report, "faults": [failed]})
    assert judge(unmet, conditions).passed is None
    assert judge(unmet, conditions).why == (failed,)
    both = msgspec.structs.replace(unmet, report={**unmet.report, "mission_completed": False})
    assert judge(both, conditions).passed is False
    assert judge(result_of(RUN, b"", "killed"), conditions).why == ("killed",)
