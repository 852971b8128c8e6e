"""The search for where passes turn into failures, on regions that are known."""

import json
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from robotctl.workbench.campaign.alone import Ending, Program
from robotctl.workbench.campaign.boundary import batches
from robotctl.workbench.campaign.campaign_file import BATCH, Campaign, Sample
from robotctl.workbench.campaign.engine import Workers, drive
from robotctl.workbench.campaign.plan import plan, runs_in_all
from robotctl.workbench.campaign.results import ResultFolder
from tests.workbench.campaign.reports import head

MASS, FRICTION = "simulation.mass_kg", "simulation.wheels.friction"


def campaign(points: int, seed: int, method: str = "boundary", seeds: int = 1) -> Campaign:
    ranges = {
        "simulation": {
            "mass_kg": {"from": 2.0, "to": 12.0},
            "wheels": {"friction": {"from": 0.4, "to": 0.9}},
        },
    }
    return Campaign(set=ranges, sample=Sample(points, method, seed), seeds=seeds)


def fails(run) -> bool:
    return run.factors[MASS] > 8.0 and run.factors[FRICTION] < 0.6


def near(runs) -> int:
    """Return how many runs are within 5 % of the ranges from the border of the failures."""
    x = np.array([(run.factors[MASS] - 2.0) / 10.0 - 0.6 for run in runs])
    y = np.array([0.4 - (run.factors[FRICTION] - 0.4) / 0.5 for run in runs])
    outside = np.hypot(np.minimum(x, 0.0), np.minimum(y, 0.0))
    return int(np.sum(np.where(outside > 0.0, outside, np.minimum(x, y)) < 0.05))


def searched(given: Campaign, passes) -> list:
    return [run for batch in batches(given, passes) for run in batch]


@pytest.mark.parametrize("points", [64, 128])
def test_three_times_as_many_points_are_at_the_border_as_of_a_latin_hypercube(points):
    found = sum(near(searched(campaign(points, s), lambda run: not fails(run))) for s in range(4))
    plain = sum(near(plan(campaign(points, s, "latin_hypercube"))) for s in range(4))
    assert found >= 3 * plain > 0


def test_all_runs_have_numbers_in_order_and_each_batch_follows_from_those_before():
    given = campaign(40, 1, seeds=2)
    runs = searched(given, lambda run: not fails(run))
    assert [run.number for run in runs] == [*range(1, runs_in_all(given) + 1)]
    assert runs_in_all(given) == 80
    assert len({run.words for run in runs}) == 80
    assert runs == searched(given, lambda run: not fails(run))
    assert tuple(runs[: 2 * BATCH]) == plan(given)
    other = searched(given, lambda _: True)
    assert other[: 2 * BATCH] == runs[: 2 * BATCH]
    assert other[2 * BATCH :] != runs[2 * BATCH :]


def test_without_a_failure_or_a_result_the_points_fill_the_ranges():
    for passed in (True, False, None):
        runs = searched(campaign(48, 1), lambda _, passed=passed: passed)
        shares = np.array([(run.factors[MASS] - 2.0) / 10.0 for run in runs])
        assert np.all(np.histogram(shares, bins=4, range=(0.0, 1.0))[0] >= 5)


def test_a_campaign_without_a_search_has_one_batch():
    given = campaign(20, 1, "latin_hypercube")
    assert [*batches(given, lambda _: None)] == [plan(given)]


def driven(folder, workers: int, lost: str = "") -> bytes:
    """Drive a search, one of whose runs may be lost; return the lines of its results."""

    def run(_program, words, _wall_seconds) -> Ending:
        if lost in words:
            return Ending(reason="killed")
        mass, friction = (float(each.partition("=")[2]) for each in words if "simulation." in each)
        time.sleep(0.005 * (hash(words) % 3))  # they end in any order
        passed = not (mass > 8.0 and friction < 0.6)
        return Ending(json.dumps({"mission_completed": passed, "faults": []}).encode())

    given = campaign(48, 3)
    with ThreadPoolExecutor(workers) as pool, ResultFolder(folder, head(48)) as kept:
        program = Program(lambda: None)
        drive(batches(given, kept.passes), kept, Workers(pool, workers, run), program, 1.0, print)
    return (folder / "runs.jsonl").read_bytes()


def test_the_results_are_the_same_for_any_workers_and_after_a_run_was_lost(tmp_path):
    whole = driven(tmp_path / "one", 1)
    assert whole.count(b"\n") == 48
    assert driven(tmp_path / "three", 3) == whole
    lost = json.loads(whole.splitlines()[4])["words"][-5]
    assert lost.startswith(FRICTION)
    before = driven(tmp_path / "lost", 2, lost)
    assert before != whole
    assert driven(tmp_path / "lost", 2) == whole
