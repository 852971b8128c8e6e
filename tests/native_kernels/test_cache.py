"""Where compiled code is kept: wherever somebody may write, or nowhere, and then all works too.

Copies of the packages have a file where their cache would be: not even root can write there.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import pytest

from native_kernels import cache

ROOT = Path(__file__).parents[2]
PACKAGES = ("robotctl", "firmware_sim")
KERNEL = """from native_kernels.compiled import compiled


@compiled
def half(x):
    return 0.5 * x
"""
"""A module with one compiled function: what is tested here is where that is kept."""


Start: TypeAlias = Callable[..., tuple[int, str]]


@pytest.fixture
def package(request: pytest.FixtureRequest) -> str:
    return str(getattr(request, "param", "robotctl"))


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """What compiles and caches, of an installation that nobody can write to."""
    folder = tmp_path / "installed"
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "native_kernels", folder / "native_kernels", ignore=ignore)
    for name in PACKAGES:
        (folder / name).mkdir()
        (folder / name / "__init__.py").touch()
        (folder / name / "kernel.py").write_text(KERNEL)
        (folder / name / "__pycache__").write_text("no folder")
    return folder


@pytest.fixture
def whole(installed: Path) -> Path:
    """All of the installation."""
    ignore = shutil.ignore_patterns("__pycache__")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, installed / name, ignore=ignore, dirs_exist_ok=True)
    shutil.copytree(ROOT / "configs", installed / "configs")
    return installed


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / "home").mkdir()
    return tmp_path / "home"


@pytest.fixture(scope="module")
def calls() -> Iterator[subprocess.Popen[str]]:
    """New processes that call a compiled function."""
    command = [sys.executable, "-I", Path(__file__).with_name("compiled_calls.py")]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process
        process.stdin.close()


@pytest.fixture
def start(calls: subprocess.Popen[str], installed: Path, package: str) -> Start:
    """Return what halves 3 in a new process: how often the cache had the code, and where."""

    def started(
        *,
        home: Path | str,
        temporary: Path | str,
        named: str = "",
        full: bool = False,
        sources: Path = installed,
        expected: float = 1.5,
    ) -> tuple[int, str]:
        order = {
            "installed": str(sources),
            "package": package,
            "environment": {"HOME": str(home), "NUMBA_CACHE_DIR": named},
            "temporary": str(temporary),
            "full": full,
        }
        print(json.dumps(order), file=calls.stdin, flush=True)
        result, hits, place = json.loads(calls.stdout.readline())
        assert result == expected
        return hits, place

    return started


@pytest.mark.parametrize("package", PACKAGES, indirect=True)
def test_it_is_kept_in_the_users_cache(
    start: Start, package: str, home: Path, tmp_path: Path
) -> None:
    first = start(home=home, temporary=tmp_path)
    second = start(home=home, temporary=tmp_path)
    assert (first[0], second[0]) == (0, 1)
    assert Path(first[1]).is_relative_to(home / ".cache" / "robotctl" / package.rpartition(".")[2])


@pytest.mark.parametrize("home", ["/proc", "relative"])
def test_it_is_kept_in_a_private_temporary_folder_of_a_user_without_a_home(
    start: Start, home: str, tmp_path: Path
) -> None:
    first = start(home=home, temporary=tmp_path)
    second = start(home=home, temporary=tmp_path)
    assert (first[0], second[0]) == (0, 1)
    folder = tmp_path / f"robotctl-cache-{os.geteuid()}"
    assert Path(first[1]).is_relative_to(folder)
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("trap", ["open to others", "link"])
def test_a_temporary_folder_that_others_could_write_to_is_not_trusted(
    start: Start, tmp_path: Path, trap: str
) -> None:
    folder = tmp_path / f"robotctl-cache-{os.geteuid()}"
    target = tmp_path / "elsewhere"
    target.mkdir(mode=0o700)
    if trap == "open to others":
        folder.mkdir()
        folder.chmod(0o777)
    else:
        folder.symlink_to(target)
    assert start(home="/proc", temporary=tmp_path) == (0, "None")
    assert not list(target.iterdir())


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give folders away")
def test_a_temporary_folder_of_another_user_is_not_trusted(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / f"robotctl-cache-{os.geteuid()}"
    folder.mkdir(mode=0o700)
    os.chown(folder, 1234, 1234)
    assert start(home="/proc", temporary=tmp_path) == (0, "None")


def test_nothing_is_kept_where_nothing_can_be_written(start: Start) -> None:
    assert start(home="/proc", temporary="/proc") == (0, "None")


def test_a_folder_that_the_user_names_comes_first(start: Start, home: Path, tmp_path: Path) -> None:
    named = str(tmp_path / "mine")
    _, place = start(home=home, temporary=tmp_path, named=named)
    assert Path(place).is_relative_to(tmp_path / "mine")


@pytest.mark.parametrize(("suffix", "left"), [(".nbi", 0), (".nbi", 40), (".nbc", 200)])
def test_a_file_that_was_cut_is_compiled_anew(
    start: Start, home: Path, tmp_path: Path, suffix: str, left: int
) -> None:
    _, place = start(home=home, temporary=tmp_path)
    for file in Path(place).glob(f"*{suffix}"):
        file.write_bytes(file.read_bytes()[:left])
    hits = [start(home=home, temporary=tmp_path)[0] for _ in range(2)]
    assert hits == [0, 1]


def test_a_constant_that_another_file_defines_is_part_of_the_code(
    start: Start, installed: Path, package: str, home: Path, tmp_path: Path
) -> None:
    constants, kernel = (installed / package / f"{name}.py" for name in ("constants", "kernel"))
    constants.write_text("from typing import Final\n\nHALF: Final = 0.5\n")
    text = kernel.read_text().replace("0.5 *", "HALF *")
    kernel.write_text(f"from {package}.constants import HALF\n{text}")
    hits = [start(home=home, temporary=tmp_path)[0] for _ in range(2)]
    constants.write_text(constants.read_text().replace("0.5", "0.25"))
    assert [*hits, start(home=home, temporary=tmp_path, expected=0.75)[0]] == [0, 1, 0]


TIMES = """from native_kernels.compiled import compiled
from {package} import offsets
from {package}.share import Share


@compiled
def times(x, share: Share):
    return x * share.part + offsets.ZERO
"""
"""A kernel that another one calls with a named tuple of a third file."""
MODULES = {
    "sizes": "WHOLE = 2.0\nPART = 1.0 / WHOLE\n",
    "share": "from typing import NamedTuple\n\nclass Share(NamedTuple):\n"
    "    part: float\n    other: float\n",
    "offsets": "ZERO = 0.0\n",
    "times": TIMES,
    "kernel": KERNEL
    .replace("\n\n\n", "\nfrom {package}.sizes import PART\nfrom {package}.share import Share\n"
             "from {package}.times import times as scaled\n\n\n", 1)
    .replace("0.5 * x", "scaled(x, Share(PART, 0.25))"),
    "unused": KERNEL.replace("half", "unused"),
}  # fmt: skip


@pytest.fixture
def linked(installed: Path, package: str) -> Path:
    """Modules of which one has a kernel that is made of things in four others."""
    for name, text in MODULES.items():
        (installed / package / f"{name}.py").write_text(text.replace("{package}", package))
    return installed / package


@pytest.mark.parametrize(
    ("module", "old", "new", "expected"),
    [
        ("sizes", "WHOLE = 2.0", "WHOLE = 4.0", 0.75),
        ("sizes", "2.0\n", "2.0\nif WHOLE:\n    WHOLE += 2.0\n", 0.75),
        ("offsets", "0.0", "1.0", 2.5),
        ("times", "x * share", "2.0 * x * share", 3.0),
        ("share", "part: float\n    other", "other: float\n    part", 0.75),
    ],
    ids=[
        "constant of a constant",
        "constant set anew",
        "constant of a module",
        "called kernel",
        "order of fields",
    ],
)
def test_code_is_made_anew_when_anything_changes_that_it_is_made_of(
    start: Start, linked: Path, home: Path, tmp_path: Path,
    module: str, old: str, new: str, expected: float,
) -> None:  # fmt: skip
    first = start(home=home, temporary=tmp_path)
    file = linked / f"{module}.py"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    second = start(home=home, temporary=tmp_path, expected=expected)
    assert (first[0], second[0]) == (0, 0)


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("times", "    return", '    """Return a share."""\n\n    return'),
        ("kernel", "@compiled", "# A half.\n\n@compiled"),
        ("unused", "0.5", "0.7"),
        ("sizes", "WHOLE", "UNUSED = 3.0\nWHOLE"),
    ],
    ids=["docstring", "comment", "another kernel", "another constant"],
)
def test_code_stays_when_only_words_or_other_things_change(
    start: Start, linked: Path, home: Path, tmp_path: Path, module: str, old: str, new: str
) -> None:
    first = start(home=home, temporary=tmp_path)
    file = linked / f"{module}.py"
    file.write_text(file.read_text().replace(old, new, 1))
    second = start(home=home, temporary=tmp_path)
    assert (first[0], second[0]) == (0, 1)


def test_a_copy_of_the_same_sources_shares_it(
    start: Start, installed: Path, home: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(installed, tmp_path / "copy")
    hits = [start(home=home, temporary=tmp_path, sources=each)[0] for each in (installed, copy)]
    assert hits == [0, 1]


def test_a_disk_that_is_full_only_costs_time(start: Start, home: Path, tmp_path: Path) -> None:
    hits, _ = start(home=home, temporary=tmp_path, full=True)
    assert hits == 0


def test_a_command_says_once_that_nothing_is_kept(whole: Path) -> None:
    code = (
        "import sys, tempfile; tempfile.tempdir = '/proc'\n"
        "sys.argv[1:] = 'plan --map flat --start 1,1 --goal 2,1'.split()\n"
        "from robotctl.cli.main import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=whole, env={"HOME": "/proc"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert done.stderr.count("NUMBA_CACHE_DIR") == 1


def test_a_folder_that_is_complete_need_not_take_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "_parents", lambda _: iter([tmp_path / "theirs", tmp_path]))
    theirs = Path(cache._cache_folder(tmp_path, "0123", {}))
    assert theirs.parent == tmp_path / "theirs"
    takes = cache._takes_files
    monkeypatch.setattr(
        cache, "_takes_files", lambda each, known: each.parent == tmp_path and takes(each, known)
    )
    assert Path(cache._cache_folder(tmp_path, "0123", {})).parent == tmp_path
    (theirs / cache._mark("any")).touch()
    assert Path(cache._cache_folder(tmp_path, "0123", {})) == theirs


def test_sources_that_are_long_as_they_are_need_not_be_read(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel, read = installed / "robotctl" / "kernel.py", []
    known = cache._digests_of
    monkeypatch.setattr(cache, "_parents", lambda _: iter([tmp_path / "cache"]))
    monkeypatch.setattr(cache, "_digests_of", lambda *known_by: read.append(1) or known(*known_by))

    def digests() -> dict[str, str]:
        return cache._digests(installed / "robotctl")

    first = digests()
    assert (digests(), len(read)) == (first, 2)  # just written, they may change within a tick
    monkeypatch.setattr(cache, "_GRAIN_NS", -3_600_000_000_000)
    assert [digests(), digests()] == [first, first]
    assert len(read) == 3
    status = kernel.stat()
    kernel.write_text(kernel.read_text().replace("0.5", "0.7"))
    os.utime(kernel, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert kernel.stat().st_size == status.st_size
    assert digests() != first
