import json
import tomllib
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from robotctl.workbench.campaign.alone import Ending
from robotctl.workbench.campaign.campaign_file import Campaign
from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.minimise import alike, case_of, ddmin, keep, minimised
from robotctl.workbench.campaign.plan import plan
from robotctl.workbench.campaign.results import Result, result_of
from robotctl.workbench.campaign.statistics import summarise
from tests.workbench.campaign.reports import head, result

GUILTY = "limits.v_max_m_s"
CAMPAIGN = Campaign(
    missions=("patrol",),
    faults=("bus",),
    set={"limits": {"v_max_m_s": [0.5]}, "simulation": {"mass_kg": 4.0, "wall_friction": 0.2}},
    seeds=(9,),
)
CONDITIONS = head(1, *Campaign().criteria).conditions
BROKEN = b'{"mission_completed": true, "collisions": 2, "unsafe_motions": 0, "faults": []}'
FINE = BROKEN.replace(b"2", b"0")


@given(
    st.integers(1, 40).flatmap(
        lambda n: st.tuples(st.just(n), st.sets(st.integers(0, n - 1), max_size=4))
    )
)
def test_what_is_left_is_all_that_is_needed_and_nothing_else(parts_and_needed):
    count, needed = parts_and_needed
    tried = []

    def fails(kept):
        tried.append([*kept])
        return needed <= {*kept}

    found = ddmin(range(count), fails)
    assert {*found} == needed or (not needed and found == [])
    assert len(tried) <= (len(needed) + 1) * 4 * (count.bit_length() + len(needed)) + 4


@given(st.integers(1, 12), st.randoms())
def test_of_what_is_left_nothing_can_be_left_out_whatever_fails(count, random):
    answers: dict[tuple[int, ...], bool] = {tuple(range(count)): True}

    def fails(kept):
        return answers.setdefault(tuple(kept), random.random() < 0.5)

    found = ddmin(range(count), fails)
    assert fails(found)
    for index in range(len(found)):
        rest = found[:index] + found[index + 1 :]
        if rest or len(found) == 1:
            assert not fails(rest)


def run(words) -> Ending:
    """Collide while the second item is driven to its third point under a lost frame, and fast."""
    option = dict(zip(words[2::2], words[3::2], strict=False))
    mission = tomllib.loads(Path(option["--mission"]).read_text())
    names = [each.get("name") for each in mission["item"]]
    ends = "square" in names and len(mission["item"][names.index("square")]["waypoints"]) >= 3
    lost = "--faults" in option and "frames_lost" in Path(option["--faults"]).read_text()
    fast = any(each.startswith(GUILTY) for each in words)
    assert words[-2:] == ("--seed", "9")
    return Ending(BROKEN if ends and lost and fast else FINE)


def failed() -> Result:
    (only,) = plan(CAMPAIGN)
    return result_of(only, BROKEN, "")


def test_a_failure_keeps_its_seed_and_only_what_it_needs():
    before = case_of(CAMPAIGN, failed())
    assert (before.items, before.faults, len(before.settings)) == (5, 5, 3)
    after, runs = minimised(before, CONDITIONS, failed(), run)
    assert [each["kind"] for each in after.scenario["fault"]] == ["frames_lost"]
    assert after.scenario["seed"] == 1
    assert after.settings == {GUILTY: 0.5}
    assert [each["name"] for each in after.mission["item"]] == ["square"]
    assert len(after.mission["item"][0]["waypoints"]) == 3
    assert after.seed == 9
    assert runs < 40


def test_a_run_without_a_result_or_with_another_failure_is_no_smaller_case():
    before = case_of(CAMPAIGN, failed())
    other = json.dumps(json.loads(FINE) | {"mission_completed": False}).encode()
    for ending in (Ending(reason="killed"), Ending(other)):
        after, _ = minimised(before, CONDITIONS, failed(), lambda _, ending=ending: ending)
        assert after == before


def test_what_is_kept_is_a_campaign_of_that_one_run_wherever_the_corpus_is(tmp_path):
    after, _ = minimised(case_of(CAMPAIGN, failed()), CONDITIONS, failed(), run)
    file = keep(tmp_path / "corpus", "c-1", after, CAMPAIGN.criteria, "why\nhow")
    moved = file.parent.rename(tmp_path / "moved")
    loaded = load_campaign(moved / file.name, lambda _: "")
    assert loaded.criteria == CAMPAIGN.criteria
    (only,) = plan(loaded)
    assert only.factors[GUILTY] == 0.5
    assert run(only.words).report == BROKEN
    assert (moved / file.name).read_text().startswith("# why\n# how\n")


def test_failures_are_alike_if_the_same_breaks_in_the_same_place():
    criteria = ("collisions = 0", "time_s <= 5")
    factors = [{"robot": robot, "seed": seed} for robot in "ab" for seed in (1, 2)]
    results = [
        result(number, False, each, collisions=1, time_s=9 if number == 4 else 1)
        for number, each in enumerate(factors, 1)
    ]
    summary = summarise(head(4, *criteria), results)
    groups = alike(summary.failures, summary.head)
    assert sorted([each.result.number for each in group] for group in groups) == [[1, 2], [3], [4]]
