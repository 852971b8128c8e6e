"""State files: whatever is killed, cut or damaged, the old value or the new one comes back."""

import contextlib
import errno
import itertools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.runtime.storage.state_file import StateError, StateFile


class Value(msgspec.Struct, frozen=True):
    number: int
    text: str = ""


OLD, NEW = Value(1, "old"), Value(2, "new " * 50)
SAVING = (
    "import sys; from pathlib import Path; import msgspec\n"
    "from robotctl.runtime.storage.state_file import StateFile\n"
    "class Value(msgspec.Struct):\n"
    "    number: int\n"
    "    text: str = ''\n"
    "StateFile(Path(sys.argv[1]), Value).save(Value(2, 'new ' * 50))\n"
)


class Killed(BaseException):
    """The process does not live to see the end of a call."""


class Killing:
    """Module `os` of a process that is killed at its n-th call, before it or half way through."""

    def __init__(self, at: int, *, after: bool) -> None:
        self.calls = 0
        self._at, self._after = at, after

    def __getattr__(self, name: str):
        def call(*arguments):
            self.calls += 1
            if self.calls != self._at:
                return getattr(os, name)(*arguments)
            if self._after:
                if name == "write":
                    descriptor, data = arguments
                    arguments = descriptor, data[: len(data) // 2]
                with contextlib.suppress(FileNotFoundError):
                    getattr(os, name)(*arguments)
            raise Killed

        return call


class Refusing:
    """Module `os` on a disk that refuses one call, with the given error."""

    def __init__(self, name: str, number: int) -> None:
        self._name, self._error = name, OSError(number, os.strerror(number))

    def __getattr__(self, name: str):
        def call(*arguments):
            if name == self._name:
                raise self._error
            return getattr(os, name)(*arguments)

        return call


class Dribbling:
    """Module `os` whose writes take three bytes at a time."""

    def __getattr__(self, name: str):
        if name == "write":
            return lambda descriptor, data: os.write(descriptor, data[:3])
        return getattr(os, name)


class PowerCut:
    """Module `os` over a disk in memory that forgets, at a cut, what was not brought to it.

    Names are kept in the order of the renames (a journal), contents in any state between nothing
    and all; `disks` returns every disk that a cut after the calls so far can leave.
    """

    def __init__(self) -> None:
        self._contents: list[tuple[bytearray, bytes | None]] = []
        self._names: dict[str, int] = {}
        self._journal: list[dict[str, int]] = [{}]
        self._open: dict[int, int] = {}

    def open(self, path, flags, mode):
        descriptor = len(self._open) + 100
        name = str(path)
        if flags & os.O_DIRECTORY:
            self._open[descriptor] = -1
        elif flags & os.O_CREAT:
            self._contents.append((bytearray(), None))
            self._names[name] = self._open[descriptor] = len(self._contents) - 1
            self._journal.append(dict(self._names))
        else:
            raise AssertionError("saving reads nothing")
        return descriptor

    def write(self, descriptor, data):
        self._contents[self._open[descriptor]][0].extend(data)
        return len(data)

    def fsync(self, descriptor):
        index = self._open[descriptor]
        if index < 0:
            self._journal = [dict(self._names)]
        else:
            content = self._contents[index][0]
            self._contents[index] = content, bytes(content)

    def close(self, descriptor):
        pass

    def rename(self, source, target):
        if str(source) not in self._names:
            raise FileNotFoundError(errno.ENOENT, "no such file")
        self._names[str(target)] = self._names.pop(str(source))
        self._journal.append(dict(self._names))

    def disks(self):
        for names in self._journal:
            choices = []
            for index in names.values():
                content, synced = self._contents[index]
                half = bytes(content[: len(content) // 2])
                choices.append([synced] if synced is not None else [b"", half, bytes(content)])
            for contents in itertools.product(*choices):
                yield dict(zip(names, contents, strict=True))


def saved(folder: Path, *values: Value) -> Path:
    """Save values, one after the other."""
    path = folder / "state.json"
    for value in values:
        StateFile(path, Value).save(value)
    return path


def calls_of_a_save(folder: Path) -> int:
    system = Killing(0, after=False)
    StateFile(saved(folder, OLD), Value, system).save(NEW)
    return system.calls


def test_what_was_saved_comes_back(tmp_path: Path) -> None:
    file = StateFile(saved(tmp_path, OLD, NEW), Value)
    assert file.load() == (NEW, ())


def test_nothing_saved_is_nothing_said(tmp_path: Path) -> None:
    assert StateFile(tmp_path / "state.json", Value).load() == (None, ())


@pytest.mark.parametrize("after", [False, True], ids=["before", "half way"])
@pytest.mark.parametrize("before", [(), (OLD,), (Value(0), OLD)], ids=["first", "second", "third"])
def test_a_process_killed_at_any_call_of_a_save_leaves_the_old_value_or_the_new(
    tmp_path: Path, before: tuple[Value, ...], after: bool
) -> None:
    seen = set()
    for at in range(1, calls_of_a_save(tmp_path) + 1):
        folder = tmp_path / f"{at}-{after}"
        folder.mkdir()
        path = saved(folder, *before)
        with pytest.raises(Killed):
            StateFile(path, Value, Killing(at, after=after)).save(NEW)
        value, notes = StateFile(path, Value).load()
        assert value in ({OLD, NEW} if before else {None, NEW})
        assert notes == ()
        seen.add(value)
        StateFile(path, Value).save(Value(3))
        assert StateFile(path, Value).load() == (Value(3), ())
    assert len(seen) == 2, "the calls counted do not span the save"


@pytest.mark.parametrize("saves", [1, 2, 3])
def test_a_power_cut_after_any_call_leaves_the_old_value_or_the_new(
    tmp_path: Path, saves: int
) -> None:
    """Also where the disk had nothing but what fsync brought to it."""

    class Cutting(PowerCut):
        calls = disks_seen = 0

        def __getattribute__(self, name: str):
            found = super().__getattribute__(name)
            if name in {"open", "write", "fsync", "close", "rename"}:
                self.check()
            return found

        def check(self) -> None:
            for disk in self.disks():
                self.disks_seen += 1
                for file in tmp_path.iterdir():
                    file.unlink()
                for name, content in disk.items():
                    Path(name).write_bytes(content)
                value, notes = StateFile(path, Value).load()
                assert value in allowed
                assert notes == ()

    path = tmp_path / "state.json"
    system = Cutting()
    allowed = [None]
    for number in range(saves):
        allowed.append(Value(number))
        StateFile(path, Value, system).save(Value(number))
        allowed = [Value(number)]
        system.check()
    assert system.disks_seen > 20


@pytest.mark.parametrize("call", ["openat", "write", "fsync", "close", "rename"])
def test_a_process_killed_at_any_system_call_of_a_save_leaves_the_old_value_or_the_new(
    tmp_path: Path, call: str
) -> None:
    """The real thing: strace kills the process as it enters its n-th such call on these files."""
    strace = shutil.which("strace")
    if strace is None:
        pytest.skip("strace is not installed; the same is tested above without it")
    killed = 0
    for count in range(1, 10):
        folder = tmp_path / str(count)
        folder.mkdir()
        path = saved(folder, OLD)
        files = [path, *(path.with_name(path.name + end) for end in (".new", ".previous")), folder]
        command = [strace, "-qq", "-o", str(tmp_path / "trace"), "-e", f"trace={call}"]
        for file in files:
            command += ["-P", str(file)]
        command += ["-e", f"inject={call}:signal=KILL:when={count}"]
        done = subprocess.run(
            [*command, sys.executable, "-c", SAVING, str(path)],
            env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])},
            capture_output=True,
            check=False,
        )
        value, notes = StateFile(path, Value).load()
        assert notes == ()
        if done.returncode == 0:
            assert value == NEW
            break
        assert done.returncode in {-9, 137}, done.stderr
        assert value in {OLD, NEW}
        killed += 1
    assert done.returncode == 0
    assert killed == {"openat": 2, "write": 1, "fsync": 2, "close": 2, "rename": 2}[call]


@given(st.data())
def test_a_damaged_file_is_set_aside_and_said_and_the_generation_before_is_used(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = saved(tmp_path_factory.mktemp("state"), OLD, NEW)
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        content[place] ^= 1 << data.draw(st.integers(0, 7))
    else:
        del content[place:]
    path.write_bytes(content)
    value, notes = StateFile(path, Value).load()
    assert value == OLD
    (note,) = notes
    aside = path.with_name("state.json.damaged-1")
    assert str(path) in note
    assert str(aside) in note
    assert aside.read_bytes() == content
    assert StateFile(path, Value).load() == (OLD, ())


def test_both_generations_damaged_are_both_kept_and_said(tmp_path: Path) -> None:
    path = saved(tmp_path, OLD, NEW)
    path.write_bytes(b"\x00" * 10)
    path.with_name("state.json.previous").write_bytes(b"")
    value, notes = StateFile(path, Value).load()
    assert value is None
    assert len(notes) == 2
    assert (tmp_path / "state.json.damaged-1").read_bytes() == b"\x00" * 10
    assert (tmp_path / "state.json.damaged-2").read_bytes() == b""


def test_a_value_of_another_kind_is_set_aside(tmp_path: Path) -> None:
    class Other(msgspec.Struct):
        name: str

    path = tmp_path / "state.json"
    StateFile(path, Other).save(Other("x"))
    value, (note,) = StateFile(path, Value).load()
    assert value is None
    assert "number" in note


@pytest.mark.parametrize("call", ["open", "write", "fsync", "rename"])
def test_a_disk_that_refuses_keeps_the_old_value_and_is_named(tmp_path: Path, call: str) -> None:
    path = saved(tmp_path, OLD)
    with pytest.raises(StateError, match=r"state\.json: cannot be written: No space left"):
        StateFile(path, Value, Refusing(call, errno.ENOSPC)).save(NEW)
    assert StateFile(path, Value).load() == (OLD, ())


def test_a_disk_that_cannot_be_read_is_an_error_and_not_an_empty_state(tmp_path: Path) -> None:
    path = saved(tmp_path, OLD)
    with pytest.raises(StateError, match=r"state\.json: cannot be read: Input/output error"):
        StateFile(path, Value, Refusing("read", errno.EIO)).load()


def test_a_damaged_file_that_cannot_be_set_aside_is_called_damaged_and_stays(
    tmp_path: Path,
) -> None:
    path = saved(tmp_path, OLD)
    path.write_bytes(b"robotctl-state 1 3 00000000\n{}\n")
    with pytest.raises(
        StateError, match=r"state\.json: damaged .*, cannot be set aside: Read-only"
    ):
        StateFile(path, Value, Refusing("rename", errno.EROFS)).load()
    assert path.read_bytes() == b"robotctl-state 1 3 00000000\n{}\n"


def test_short_writes_are_completed(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    StateFile(path, Value, Dribbling()).save(NEW)
    assert StateFile(path, Value).load() == (NEW, ())


@pytest.mark.timeout(10)
def test_a_fifo_in_the_place_of_the_file_is_damage_and_not_waited_for(tmp_path: Path) -> None:
    class Number(msgspec.Struct):
        value: int

    path = tmp_path / "number.json"
    os.mkfifo(path)
    file = StateFile(path, Number)
    value, (note,) = file.load()
    assert value is None
    assert f"set aside as {path}.damaged-1" in note
    file.save(Number(3))
    assert file.load() == (Number(3), ())
