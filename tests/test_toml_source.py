"""Errors in files, as a user meets them."""

import dataclasses
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest

from robotctl.errors import ConfigError, InvalidValue
from robotctl.toml_source import BY_KIND, load, parse, restored


@dataclass(frozen=True, slots=True)
class Gains:
    kp: float
    kd: float = 0.0

    def __post_init__(self) -> None:
        if self.kp < 0:
            raise InvalidValue("kp", f"must not be negative, found {self.kp}", self.kp)


@dataclass(frozen=True, slots=True)
class Round:
    kind: Literal["round"]
    radius_m: float


@dataclass(frozen=True, slots=True)
class Square:
    kind: Literal["square"]
    side_m: float


@dataclass(frozen=True, slots=True)
class File:
    gains: Gains
    left: Gains | None = None
    shape: tuple[Annotated[Round | Square, BY_KIND], ...] = ()
    names: tuple[str, ...] = field(default=())


GOOD = """\
names = ["a", "b"]

[gains]
kp = 2        # an integer will do

[[shape]]
kind = "round"
radius_m = 0.5

[[shape]]
kind = "square"
side_m = 1.0
"""


def errors(text: str, *overrides: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse(text, File, "robot.toml", overrides)
    return str(caught.value).splitlines()


def test_a_good_file_becomes_a_frozen_dataclass() -> None:
    file = parse(GOOD, File, "robot.toml")
    assert file == File(Gains(2.0), None, (Round("round", 0.5), Square("square", 1.0)), ("a", "b"))


def test_a_file_of_an_editor_that_marks_its_encoding_is_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(GOOD, encoding="utf-8-sig")
    assert load(path, File) == parse(GOOD, File, "robot.toml")


@pytest.mark.parametrize("value", ["9" * 5000, "[" * 10_000])
def test_a_value_beyond_all_sense_is_an_error_of_the_file(value: str) -> None:
    (error,) = errors(f"names = {value}")
    assert error.startswith("robot.toml: not valid TOML")


def test_an_unknown_key_names_its_line_and_the_nearest_key() -> None:
    assert errors("[gains]\nkp = 1\nkdd = 2\n") == [
        'robot.toml:3: gains.kdd: unknown key; did you mean "kd"?'
    ]


def test_an_unknown_list_of_tables_names_the_line_where_it_begins() -> None:
    (line,) = errors("[gains]\nkp = 1\n[[shap]]\n[[shap]]\n")
    assert line == 'robot.toml:3: shap: unknown key; did you mean "shape"?'


def test_all_errors_of_a_file_come_at_once() -> None:
    found = errors('[gains]\nkp = "fast"\n[[shape]]\nkind = "round"\nradus_m = 1\n')
    assert any(line.startswith("robot.toml:2: gains.kp:") and "'fast'" in line for line in found)
    assert 'robot.toml:5: shape[0].radus_m: unknown key; did you mean "radius_m"?' in found
    assert "robot.toml:3: shape[0].radius_m: missing key, it has no default" in found


def test_a_rule_of_a_constructor_is_told_at_its_key_with_what_was_found() -> None:
    wrong = "gains.kp: must not be negative, found -1.0"
    assert errors("[gains]\nkp = -1\n") == [f"robot.toml:2: {wrong}"]
    assert errors("gains.kp = -1\n") == [f"robot.toml:1: {wrong}"]
    assert errors("gains = {kd = 1, kp = -1}\n") == [f"robot.toml:1: {wrong}"]
    assert errors(GOOD, "gains.kp=-1") == [f"--set gains.kp=-1: {wrong}"]
    (line,) = errors('[gains]\nkp = 1\n[[shape]]\nradius_m = "1"\nkind = "round"\n')
    assert line.startswith("robot.toml:4: shape[0].radius_m: ")
    assert line.endswith(", found '1'")


@dataclass(frozen=True, slots=True)
class Pair:
    low: int = 0
    gains: Gains = field(default_factory=lambda: Gains(1.0))

    def __post_init__(self) -> None:
        if self.low == 1:
            raise InvalidValue("low", "darf nicht eins sein", self.low)
        if self.low == 2:
            raise InvalidValue("gains.kp", "is too much for low 2", self.gains.kp)
        if self.low == 3:
            raise InvalidValue("other", "must be there", None)
        if self.low == 4:
            raise ValueError("low must not be 4: it is only said in words")


@pytest.mark.parametrize(
    ("low", "said"),
    [
        (1, "robot.toml:2: pair.low: darf nicht eins sein"),
        (2, "robot.toml:4: pair.gains.kp: is too much for low 2"),
        (3, "robot.toml:1: pair: other must be there"),
        (4, "robot.toml:1: pair: low must not be 4: it is only said in words"),
    ],
)
def test_the_key_to_blame_is_the_one_of_the_error_and_not_one_read_from_its_words(
    low: int, said: str
) -> None:
    @dataclass(frozen=True, slots=True)
    class PairFile:
        pair: Pair

    with pytest.raises(ConfigError) as caught:
        parse(f"[pair]\nlow = {low}\n[pair.gains]\nkp = 1\n", PairFile, "robot.toml")
    assert str(caught.value) == said


def test_a_wrong_value_says_key_rule_and_value() -> None:
    with pytest.raises(InvalidValue) as caught:
        Gains(-1.0)
    error = caught.value
    assert (error.key, error.value) == ("kp", -1.0)
    assert str(error) == f"kp {error.rule}" == "kp must not be negative, found -1.0"
    assert str(InvalidValue("kp", "2 found, 1 allowed", 2)) == "kp: 2 found, 1 allowed"


def test_a_rule_of_several_keys_blames_the_one_that_it_names_first() -> None:
    def rules(file: File) -> list[tuple[tuple[str | int, ...], str]]:
        return [(("gains", "kd"), "kd is wrong"), (("left", "kp"), "kp is wrong")]

    with pytest.raises(ConfigError) as caught:
        parse("names = []\n[gains]\nkp = 1\n", File, "robot.toml", (), rules)
    assert str(caught.value).splitlines() == [
        "robot.toml:2: gains.kd: kd is wrong",
        "robot.toml: left.kp: kp is wrong",
    ]


def test_lines_are_right_behind_values_that_look_like_headers() -> None:
    text = 'names = [\n  "a", "b",\n  "[gains]"\n]\n[gains]\nkp = 1\nkdd = """\n[left]\n"""\n'
    (line,) = errors(text)
    assert line.startswith("robot.toml:7: gains.kdd: unknown key")


def test_a_wrong_kind_names_the_allowed_ones() -> None:
    (line,) = errors('[gains]\nkp = 1\n[[shape]]\nkind = "oval"\n')
    assert line.startswith("robot.toml:4: shape[0].kind: must be one of")
    assert line.endswith("found 'oval'")
    assert "'round', 'square'" in line


def test_an_override_wins_and_is_named_in_its_own_errors() -> None:
    assert parse(GOOD, File, "robot.toml", ["gains.kp=7.5"]).gains.kp == 7.5
    assert parse(GOOD, File, "robot.toml", ["left.kp=1"]).left == Gains(1.0)
    assert parse(GOOD, File, "robot.toml", ["shape.0.radius_m=2"]).shape[0] == Round("round", 2.0)
    (line,) = errors(GOOD, "gains.kpp=7")
    assert line == '--set gains.kpp=7: gains.kpp: unknown key; did you mean "kp"?'
    (line,) = errors(GOOD, "gains.kp")
    assert "key.subkey=value" in line


@pytest.mark.parametrize(
    ("setting", "names"),
    [
        ('names=["c", "d"]', ("c", "d")),
        ("names=[c, d]", ("c", "d")),
        ("names=[front left,d.e]", ("front left", "d.e")),
        ("names=['c', udp:127.0.0.1:14]", ("c", "udp:127.0.0.1:14")),
        ("names=[]", ()),
        ('names=["a, b]", "c=d"]', ("a, b]", "c=d")),
    ],
)
def test_a_list_whose_quotes_a_shell_has_taken_is_one_of_words(setting, names) -> None:
    assert parse(GOOD, File, "robot.toml", [setting]).names == names


def test_a_table_whose_quotes_a_shell_has_taken_keeps_its_numbers() -> None:
    file = parse(GOOD, File, "robot.toml", ["shape=[{kind=round, radius_m=1.5}]"])
    assert file.shape == (Round("round", 1.5),)
    (line,) = errors(GOOD, "names=[a, 3]")
    assert "names[1]" in line


def test_a_table_that_a_setting_made_up_is_blamed_on_the_setting() -> None:
    (line,) = errors(GOOD, "nonsense.a.b=1")
    assert line.startswith("--set nonsense.a.b=1: nonsense: unknown key")
    (line,) = errors(GOOD, "gains.foo.bar=1")
    assert line.startswith("--set gains.foo.bar=1: gains.foo: unknown key")
    (line,) = errors(GOOD + "[gian]\nkp = 1\n", "gian.kd=1")
    assert line.startswith("robot.toml:")
    (line,) = errors("", "gains.kd=1")
    assert line.startswith("robot.toml: gains.kp: missing key")


def test_an_index_in_brackets_is_told_its_spelling() -> None:
    (line,) = errors(GOOD, "shape[0].radius_m=2")
    assert line == ("--set shape[0].radius_m=2: shape[0].radius_m found, write shape.0.radius_m")


def test_a_number_must_not_come_as_text() -> None:
    (line,) = errors('[gains]\nkp = "2"\n')
    assert "robot.toml:2: gains.kp" in line


def test_text_that_is_no_toml_says_where() -> None:
    (line,) = errors("[gains\nkp = 1\n")
    assert "not valid TOML" in line
    assert "line 1" in line


@pytest.mark.parametrize("date", ["2024-01-31", "2024-01-31T10:00:00Z", "10:00:00"])
def test_a_date_is_no_value_of_any_key(date: str) -> None:
    text = GOOD.replace("kp = 2 ", f"kp = {date} ").replace('"b"', date)
    found = date.replace("T", " ").replace("Z", "+00:00")
    assert errors(text) == [
        f"robot.toml:1: names[1]: must be no date or time, found {found}",
        f"robot.toml:4: gains.kp: must be no date or time, found {found}",
    ]
    assert errors(GOOD, f"gains.kp={date}") == [
        f"--set gains.kp={date}: gains.kp: must be no date or time, found {found}"
    ]


@pytest.mark.parametrize("below", ["x", "x.y", "0"])
def test_a_setting_below_a_number_is_refused(below: str) -> None:
    assert errors(GOOD, f"gains.kp.{below}=1") == [
        f"--set gains.kp.{below}=1: gains.kp is 2, which has no keys below it"
    ]


def test_all_wrong_settings_are_told_at_once() -> None:
    assert errors(GOOD, "gains.kpp=2", "shape.9.radius_m=0.1", "gains", "gains.kp=-1") == [
        "--set shape.9.radius_m=0.1: shape[9]: no such key; its entries are shape.0 to shape.1",
        "--set gains: not of the form key.subkey=value",
        '--set gains.kpp=2: gains.kpp: unknown key; did you mean "kp"?',
        "--set gains.kp=-1: gains.kp: must not be negative, found -1.0",
    ]


def test_a_setting_that_is_not_utf_8_is_refused() -> None:
    (said,) = errors(GOOD, "gains.kp=caf\udce9")
    assert said == "--set gains.kp=caf\udce9: not UTF-8"


def test_what_was_read_is_the_same_again_from_its_plain_data() -> None:
    file = parse(GOOD, File, "robot.toml")
    plain = json.loads(json.dumps(dataclasses.asdict(file)))
    assert repr(restored(File, plain)) == repr(file)
    plain["gains"]["kp"] = 2
    assert restored(File, plain | {"since_removed": 1}) == file


@pytest.mark.parametrize(
    ("gains", "said"),
    [
        ({}, "Gains: .*missing.*'kp'"),
        ({"kp": "2"}, "float needed, found '2'"),
        ({"kp": True}, "float needed, found true"),
        ({"kp": -1.0}, "kp must not be negative, found -1.0"),
        ({"kp": {}}, "float needed, found a table"),
        (3, "Gains needed, found 3"),
        (None, "Gains needed, found None"),
        ({"kp": None}, "float needed, found None"),
    ],
)
def test_plain_data_of_another_version_are_refused(gains: object, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        restored(File, {"gains": gains})


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ({"kind": "oval", "radius_m": 1.0}, "a table found, of no kind that this version knows"),
        ({"kind": ["round"], "radius_m": 1.0}, "a table found, of no kind"),
        ({"radius_m": 1.0}, "a table found, of no kind"),
        ("round", "'round' found"),
    ],
)
def test_a_table_of_an_unknown_kind_is_refused(shape: object, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        restored(File, {"gains": {"kp": 1.0}, "shape": [shape]})
