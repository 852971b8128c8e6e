"""Ctrl-C ends what would go on, also where Python drops the exception."""

import os
import signal
from collections.abc import Iterator

import pytest

from robotctl.app.supervision.signals import CtrlC


@pytest.fixture
def ctrl_c() -> Iterator[CtrlC]:
    """Ctrl-C as a campaign takes it."""
    before = signal.getsignal(signal.SIGINT)
    yield CtrlC()
    signal.signal(signal.SIGINT, before)


class Freed:
    """Something that is freed just as Ctrl-C comes."""

    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGINT)


def test_without_ctrl_c_a_loop_goes_on(ctrl_c: CtrlC) -> None:
    ctrl_c.check()


def test_ctrl_c_is_an_exception(ctrl_c: CtrlC) -> None:
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_ctrl_c_counts_where_python_drops_the_exception(ctrl_c: CtrlC) -> None:
    freed = Freed()
    del freed
    with pytest.raises(KeyboardInterrupt):
        ctrl_c.check()
