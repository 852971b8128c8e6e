"""What is told while functions are compiled."""

import numba
import pytest

from native_kernels.cache import cache_of
from robotctl.app import compile_progress as progress
from robotctl.app.compile_progress import announce_compiling, compile_progress, compiling


def fresh(module: str) -> object:
    """Return a function of a module that is compiled when it is called."""

    def function(x: float) -> float:
        return x + 1.0

    function.__module__ = module
    return numba.njit(function)


def test_what_compiles_is_told_once_and_then_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(progress, "_EVERY_S", 0.0)
    said: list[str] = []
    ours, others = fresh("robotctl.estimation.tried"), fresh("elsewhere")
    with compile_progress(said.append):
        assert ours(1.0) == 2.0  # type: ignore[operator]
        assert others(1.0) == 2.0  # type: ignore[operator]
        assert ours(2.0) == 3.0  # type: ignore[operator]
    assert said[0] == compiling()
    assert [line.partition(" of at most ")[0] for line in said[1:]] == ["compiling: 1"] * 2
    fresh("robotctl.estimation.tried")(1.0)  # type: ignore[operator]
    assert len(said) == 3


def test_what_is_compiled_already_is_not_told() -> None:
    function = fresh("robotctl.estimation.tried")
    function(1.0)  # type: ignore[operator]
    said: list[str] = []
    with compile_progress(said.append):
        function(1.0)  # type: ignore[operator]
    assert said == []


def test_a_command_says_that_it_compiles_whatever_else_is_compiled_already() -> None:
    fresh("robotctl.estimation.tried")(1.0)  # type: ignore[operator]
    first: list[str] = []
    second: list[str] = []
    announce_compiling(first.append)
    fresh("robotctl.estimation.other")(1.0)  # type: ignore[operator]
    announce_compiling(second.append)
    fresh("robotctl.estimation.other")(1.0)  # type: ignore[operator]
    announce_compiling(lambda _: None)
    assert (first, second) == ([compiling()], [compiling()])


@pytest.mark.parametrize(
    ("folder", "said"), [("", "NUMBA_CACHE_DIR"), ("/mine/compiled-12", "kept in /mine")]
)
def test_people_are_told_where_it_is_kept(
    monkeypatch: pytest.MonkeyPatch, folder: str, said: str
) -> None:
    monkeypatch.setattr(cache_of("robotctl"), "folder", folder)
    assert said in compiling()
