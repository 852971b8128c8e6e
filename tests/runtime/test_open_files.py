"""Too few open files are a sentence at the start of a robot, not an abort while it drives."""

import resource

import pytest

from robotctl.runtime.open_files import NEEDED, OpenFilesError, need_open_files


@pytest.mark.skipif(resource.getrlimit(resource.RLIMIT_NOFILE)[1] < NEEDED, reason="too few here")
def test_a_low_limit_that_may_be_raised_is_raised():
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (NEEDED - 1, before[1]))
        need_open_files()
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (NEEDED, before[1])
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_one_that_may_not_says_what_is_needed(monkeypatch):
    def refuse(*_):
        raise ValueError("not allowed to raise maximum limit")

    monkeypatch.setattr(resource, "getrlimit", lambda _: (40, 40))
    monkeypatch.setattr(resource, "setrlimit", refuse)
    with pytest.raises(
        OpenFilesError, match=r"only 40 files may be open .* 256: raise .*ulimit -n"
    ):
        need_open_files()
