import pytest

from robotctl.errors import ConfigError
from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.plan import files_of, plan
from robotctl.workbench.campaign.results import head_of

MISSION = (
    'name = "there"\nworld = "flat"\nstart = { x_m = 1.0, y_m = 1.0 }\n[[item]]\nkind = "drive"\n'
    "waypoints = [[1.0, 1.0], [2.0, 1.0]]\n"
)


def load(tmp_path, text, check=lambda _: ""):
    file = tmp_path / "c.toml"
    file.write_text(text)
    return load_campaign(file, check)


def test_names_are_found_beside_the_file_or_among_the_built_in_ones(tmp_path):
    (tmp_path / "there.toml").write_text(MISSION)
    loaded = load(tmp_path, 'missions = ["there", "patrol"]\nfaults = ["", "bus"]\n')
    assert loaded.missions == (str(tmp_path / "there.toml"), "patrol")
    assert loaded.faults == ("", "bus")
    assert plan(loaded)[0].factors["mission"] == "there"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('\nrobots = ["dif_drive"]', ":2: robots[0]: dif_drive: no such file"),
        ('robots = ["dif_drive"]', 'did you mean "diff_drive"?'),
        ('worlds = ["flatt"]', ":1: worlds[0]: flatt: no such file"),
        ('missions = ["patroll"]', 'did you mean "patrol"?'),
        ('faults = ["buss"]', 'did you mean "bus"?'),
        ('robot = "diff_drive"', ':1: robot: unknown key; did you mean "robots"?'),
        ("seeds = 0", ":1: seeds: must be at least 1, found 0"),
        ("seeds = [1, -1]", ":1: seeds: must be a list of numbers from 0 on"),
        ("robots = []", ":1: robots: must have an entry"),
        ("max_seconds = 0.5", "must be at least 1, found 0.5"),
        ('criteria = ["completed = true"]', 'did you mean "mission_completed"?'),
        ('options = ["--seed 3"]', "--seed is not allowed here"),
        ('options = ["--world=flat"]', "--world=flat is not allowed here"),
        (
            "[set]\ncontrol.left.kpp = 1.0",
            ':2: set.control.left.kpp: unknown key; did you mean "kp"',
        ),
        ("[set.control.left]\nkpp = 1.0", ":2: set.control.left.kpp: unknown key"),
        ("[set]\nsimulation.mas_kg = 1.0", 'did you mean "mass_kg"?'),
        ('[set]\nlimits.v_max_m_s = "fast"', ":2: set.limits.v_max_m_s: "),
        ("[set]\nlimits.v_max_m_s = []", "must have an entry"),
        ("[set]\nlimits.v_max_m_s = { from = 1.0 }", "a range must have numbers"),
        ("[set]\nlimits.v_max_m_s = { from = 1.0, to = 0.5 }", "from must be less than to"),
        ("[set]\nlimits.v_max_m_s = { from = 0.5, too = 1.0 }", 'did you mean "to"?'),
        ("[set]\nlimits.v_max_m_s = { from = 0.5, to = 1.0 }", "needs a table [sample]"),
        ("[sample]\npoints = 3", ":1: sample: has no effect"),
        (
            '[sample]\npoints = 3\nmethod = "latin"\n[set]\nlimits.v_max_m_s={from=0.1,to=0.5}',
            ":3: sample.method: ",
        ),
        (
            "[sample]\npoints = 0\n[set]\nlimits.v_max_m_s = { from = 0.1, to = 0.5 }",
            ":2: sample.points: must be at least 1",
        ),
        ("[set]\nlimits.v_max_m_s = -1.0", ":2: set.limits.v_max_m_s: "),
        (
            "runs = 9\n[sample]\npoints = 9\nmethod = 'boundary'\n[set]\na={from=0, to=1}",
            ":1: runs: not allowed with method =",
        ),
        ("[[case]]\nrobot = 'jackal'", ":1: case[0].name: missing key"),
        ("[[case]]\nname = 'a'\nrobots = ['jackal']", 'did you mean "robot"?'),
        ("[[case]]\nname = 'a'\nrobot = 'jakal'", ":3: case[0].robot: jakal: no such file"),
        ("[[case]]\nname = 'a'\nfaults = 'buss'", 'did you mean "bus"?'),
        ("[[case]]\nname = 'a'\noptions = '--seed 3'", ":3: case[0].options: --seed is not"),
        ("[[case]]\nname = 'a'\ncriteria = ['collision = 0']", 'did you mean "collisions"?'),
        ("[[case]]\nname = 'a'\nseed = -1", ":3: case[0].seed: must be at least 0, found -1"),
        ("seeds = 3\n[[case]]\nname = 'a'", ":1: seeds: not allowed with [[case]]"),
        (
            "[[case]]\nname = 'a'\n[case.set]\nsimulation.mas_kg = 1.0",
            ":4: case[0].set.simulation.mas_kg: unknown key",
        ),
        (
            "[[case]]\nname = 'a'\n[case.set]\nsimulation.mass_kg = { from = 1.0, to = 2.0 }",
            ":4: case[0].set.simulation.mass_kg: must be a value: a case is one run",
        ),
        (
            "[[case]]\nname = 'a'\n[[case]]\nname = 'a'\ncriteria = ['collisions = 0']",
            ":5: case[1].criteria: must be those of the first case named 'a'",
        ),
        ('buses = ["vcan0", "vcan0"]', ":1: buses: must have each bus once"),
        ('buses = ["vcan0", "vcan:1"]', ":1: buses[1]: allowed are simcan, simcan:CHANNEL or a So"),
        (f"buses = {[f'vcan{n}' for n in range(9999)]}", "a processor for each run"),
        ('options = ["--bus vcan0"]', "--bus is not allowed here"),
    ],
)
def test_what_is_wrong_is_said_with_line_and_nearest_name(tmp_path, text, said):
    with pytest.raises(ConfigError) as refused:
        load(tmp_path, text)
    assert said in str(refused.value)


def test_cases_are_runs_in_full_with_what_the_file_sets_for_all(tmp_path):
    (tmp_path / "there.toml").write_text(MISSION)
    text = (
        "[set]\nlimits.v_max_m_s = [0.3, 0.6]\n[[case]]\nname = 'a'\nmission = 'there'\nseed = 4\n"
        "[[case]]\nname = 'b'\nrobot = 'jackal'\noptions = '--people 2'\nfaults = 'bus'\n"
        "criteria = ['unsafe_motions = 0']\nset.simulation.mass_kg = 9.0\n"
    )
    loaded = load(tmp_path, text)
    runs = plan(loaded)
    assert [run.factors["case"] for run in runs] == ["a", "a", "b", "b"]
    assert [run.factors["limits.v_max_m_s"] for run in runs] == [0.3, 0.6, 0.3, 0.6]
    assert runs[0].words[2:] == (
        *("--robot", "diff_drive", "--mission", str(tmp_path / "there.toml")),
        *("--set", "limits.v_max_m_s=0.3", "--max-seconds", "300", "--seed", "4"),
    )
    assert runs[3].command == (
        "robotctl sim --lockstep --robot jackal --faults bus --people 2 --set "
        "limits.v_max_m_s=0.6 --set simulation.mass_kg=9.0 --max-seconds 300 --seed 1"
    )
    head = head_of("c", 4, loaded, ("", ""))
    assert head.criteria_of(runs[0].factors) == loaded.criteria
    assert head.criteria_of(runs[3].factors) == ("unsafe_motions = 0",)
    assert tmp_path / "there.toml" in files_of(loaded)


def test_settings_that_fit_alone_but_not_together_are_refused(tmp_path):
    text = (
        "[set]\nnavigation.pursuit.lookahead_min_m = 0.5\n"
        "navigation.pursuit.lookahead_max_m = [0.6, 0.55]\n"
    )
    load(tmp_path, text)
    with pytest.raises(ConfigError, match="lookahead_min_m"):
        load(tmp_path, text.replace("0.55", "0.45"))


def test_all_errors_of_a_file_are_said_at_once_each_once(tmp_path):
    text = 'robots = ["nix", "jackal"]\nmissions = ["nix"]\ncriteria = ["nix = 1"]\n'
    with pytest.raises(ConfigError) as refused:
        load(tmp_path, text)
    assert len(str(refused.value).splitlines()) == 3


def test_options_of_sim_are_checked_by_sim(tmp_path):
    with pytest.raises(ConfigError, match=r":1: options\[1\]: no such thing"):
        load(
            tmp_path,
            'options = ["", "--localisr mcl"]',
            lambda words: "no such thing" if words else "",
        )
