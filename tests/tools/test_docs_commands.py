"""Every command, option and file that a page of the documentation names is there."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from robotctl.cli.commands import COMMANDS, load
from tests.cli.command import status_of

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
SPAN = re.compile(r"`([^`\n]+)`")
ROBOTCTL = re.compile(r"(?:^|[\s/])robotctl ((?:[^\s`]+ ?)+)")
SENTENCE = re.compile(r"(?<=[.:;])\s+|\n\n")
OWN = re.compile(r"\bstands? for\b|\bsuch as\b")
"""Words of a sentence that names files of the reader's own."""
SHOWN = re.compile(r"((?:[^\n]+\n)+)\n```")
"""A paragraph whose last file is that of the block below."""
FILE = re.compile(
    r"[\w*{}…./-]*\w\.(?:toml|yaml|yml|pgm|gz|log|dbc|eds|csv|json|g2o|mcap|rec|py|npz|png|jpg|gif"
    r"|txt|map|parm|keyframes|bmp|tum)\b"
)
OUTPUTS = ("out", "report", "record", "csv", "plot", "show", "json", "animate", "book", "mcap")
MAKES = re.compile(
    rf"(?:--(?:{'|'.join(OUTPUTS)})|-f|>|cp \S+|record dump|params save) *([\w./-]+)"
)
FREE = re.compile(r"[A-Z]{2,}\b|/|…|\d+\.\d+\.")
"""`RUN/control-0001.rec`, what lies elsewhere on the computer, ends and times in place of names."""


@cache
def files() -> str:
    """Return the paths of all files that come along, a line each with a slash before it."""
    folders = ("robotctl", "firmware_sim", "configs", "docs", "tests", "hil_tests", "benchmarks")
    others = ("native_kernels", "tools", "examples")
    found = [path for name in (*folders, *others) for path in (ROOT / name).rglob("*")]
    return "\n".join(f"/{path.relative_to(ROOT)}" for path in (*found, *ROOT.glob("*")))


def comes_along(name: str) -> bool:
    """Return whether a file of this name, or its end, comes along; `*` and `…` stand for a part."""
    pattern = re.escape(f"/{name}").replace(r"\*", "[^/\n]*").replace("…", "[^/\n]*")
    return bool(re.search(f"{pattern}$", files(), re.MULTILINE))


@cache
def names_in_the_code() -> set[str]:
    """Return the ends of all quoted words of the programs: files that they write and read."""
    folders = ("robotctl", "firmware_sim", "native_kernels", "tools")
    return {
        name
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        for name in re.findall(r"""["'/]([\w.-]+)["']""", path.read_text(encoding="utf-8"))
    }


def is_in_the_code(name: str) -> bool:
    """Return whether a program writes or reads files of this name: `robot-0001.mcap`, `rgb.txt`."""
    stem, _, suffix = name.rpartition(".")
    stem = re.sub(r"-[\dA-Z*]+$", "", stem.rpartition("/")[2])
    return not {stem, f"{stem}.{suffix}", f"{stem}-"}.isdisjoint(names_in_the_code())


def own_files(text: str) -> set[str]:
    """Return the files that a page says the reader brings along."""
    return {
        name
        for sentence in SENTENCE.split(text)
        if OWN.search(sentence)
        for name in SPAN.findall(sentence)
    }


def shown_files(text: str) -> set[str]:
    """Return the files whose content a page shows."""
    return {name for above in SHOWN.findall(text) for name in FILE.findall(above)[-1:]}


def is_made(name: str, made: set[str]) -> bool:
    """Return whether a command makes a file, or others whose names begin with its own."""
    ends = {*made, *(Path(each).name for each in made)}
    return any(
        name == each or name.startswith((f"{each}/", f"{each}.", f"{each}-")) for each in ends
    )


def shell_lines(page: Path) -> Iterator[str]:
    """Yield the commands in blocks of a page, without comments and what was cut in two."""
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language in {"", "sh", "bash"}:
            commands = re.sub(r"<<'(\w+)'\n.*?^\1$", "", text, flags=re.DOTALL | re.MULTILINE)
            for line in commands.replace("\\\n", " ").splitlines():
                yield re.sub(r"\s#.*", "", line).strip()


def spans(page: Path) -> Iterator[str]:
    yield from SPAN.findall(BLOCK.sub("", page.read_text(encoding="utf-8")))


def command_of(words: list[str]) -> tuple[object, list[str]]:
    """Return the command that words call, and the words behind its name."""
    if " ".join(words[:2]) in COMMANDS:
        words = [" ".join(words[:2]), *words[2:]]
    assert words[0] in COMMANDS, f"robotctl {words[0]}"
    command, rest = load(words[0]), words[1:]
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        assert rest[0] in command.commands, f"robotctl {' '.join(words)}"
        command, rest = command.commands[rest[0]], rest[1:]
    return command, rest


def options_of(command: object) -> set[str]:
    return {
        each
        for parameter in command.params
        if parameter.param_type_name == "option"
        for each in (*parameter.opts, *parameter.secondary_opts)
    } | {"--help"}


def called(line: str) -> list[str] | None:
    """Return the words behind `robotctl` of a line, if it calls that."""
    match = re.match(
        r"(?:sudo )?(?:\S*/)?robotctl (.*?)(?: \|\| true| \| .*| && .*)?$", line.strip()
    )
    return None if match is None else shlex.split(match[1])


ALONE = {"--help", "--version", "--install-completion"}
CALLS = [
    pytest.param(words, id=f"{page.stem}: {' '.join(words)}"[:100])
    for page in PAGES
    for line in shell_lines(page)
    if (words := called(line)) and words[0] not in {*ALONE, "version"}
]


@pytest.mark.parametrize("words", CALLS)
def test_a_command_in_a_block_is_one_that_parses(words: list[str]) -> None:
    command, rest = command_of(words)
    command.make_context(words[0], list(rest))


MENTIONS = [
    pytest.param(words, id=f"{page.stem}: {' '.join(words)}"[:100])
    for page in PAGES
    for span in spans(page)
    if (words := called(span)) and words[0] not in {*ALONE, "version", "ends:", "SUBCOMMAND"}
]


@pytest.mark.parametrize("words", MENTIONS)
def test_a_command_in_a_sentence_has_the_options_named(words: list[str]) -> None:
    command, rest = command_of([word for word in words if word not in {"...", "…"}])
    given = {word.partition("=")[0] for word in rest if word.startswith("--")}
    assert given <= options_of(command)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_file_that_a_page_names_comes_along_or_is_made_or_is_called_the_readers_own(
    page: Path,
) -> None:
    text = page.read_text(encoding="utf-8")
    own, made, missing = own_files(text) | shown_files(text), set[str](), []

    def is_known(name: str) -> bool:
        return name in own or bool(FREE.match(name)) or comes_along(name) or is_made(name, made)

    for line in shell_lines(page):
        made |= set(MAKES.findall(line))
        names = [name for name in FILE.findall(line) if name != line.split()[0]]
        missing += [f"{name}: {line}" for name in names if not is_known(name)]
    for span in spans(page):
        made |= set(MAKES.findall(span))
        names = [name for name in FILE.findall(span) if not is_in_the_code(name)]
        missing += [f"{name}: `{span}`" for name in names if not is_known(name)]
    assert not missing, "\n".join(missing)


RUN = {"graphs": 6, "places": 4, "planning": 4, "simulated-camera": 1}
"""Pages whose commands of robotctl, so many, need no more than a checkout and are not live."""
LIVE = {"goto", "explore", "mission", "sim"}
WRITTEN = re.compile(r"^cat > (\S+) <<'(\w+)'\n(.*?)^\2$", re.DOTALL | re.MULTILINE)


@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", RUN)
def test_the_commands_of_a_page_work_in_their_order(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = ROOT / "docs" / f"{name}.md"
    text = page.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for folder in ("configs", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    for file, _, content in WRITTEN.findall(text):
        (tmp_path / file).write_text(content, encoding="utf-8")
    own, ran = own_files(text), 0
    for line in shell_lines(page):
        words = shlex.split(line)
        if own & {*words} or any(re.fullmatch("[A-Z]{2,}", word) for word in words):
            continue
        if words[:2] == ["python", "-m"]:
            assert import_module(words[2]).main(words[3:]) == 0, line
        elif words[0] == "robotctl" and words[1] not in LIVE and "--live" not in words:
            assert status_of(*words[1:]) == 0, line
            ran += 1
    assert ran >= 3 or name == "simulated-camera"
