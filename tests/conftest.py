"""Settings of all tests: examples, public recordings, and the folders run only when named."""

from __future__ import annotations

import gc
import os
import re
import time
from pathlib import Path

import pytest
from hypothesis import Phase, settings

from robotctl.messages.mavlink_port import LinkConfig

TESTS = Path(__file__).resolve().parent
# Run by `make test` where they can be: on a kernel with vcan0, and on a host that boots guests.
ONLY_WHEN_NAMED = {TESTS / "vcan", TESTS / "guest"}
MISSING = " missing: "
RECORDINGS_MISSING = f"recordings{MISSING}"

# A busy machine makes single examples slow; pytest's time-out still ends a test that hangs.
# In CI the same commit tries the same examples.
settings.register_profile("robotctl", deadline=None, derandomize="CI" in os.environ)
# For `make mutants`: the same examples for each mutant, and no search for the simplest.
settings.register_profile(
    "mutants", deadline=None, derandomize=True, phases=set(Phase) - {Phase.shrink, Phase.explain}
)
settings.load_profile("robotctl")
# What a test gives a terminal is one that knows colours, wherever the tests themselves run.
os.environ["TERM"] = "xterm-256color"


def recordings_folder() -> Path:
    """Return where public recordings are: ROBOTCTL_DATA, else beside the checkout."""
    named = os.environ.get("ROBOTCTL_DATA")
    return Path(named) if named else TESTS.parent.parent / "shared" / "data"


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of public recordings, for tests marked `recordings`."""
    return recordings_folder()


@pytest.fixture
def tmp_path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a test, with a name shorter than pytest's: paths of Unix sockets have 107 bytes."""
    name = re.sub(r"\W", "_", request.node.name.removeprefix("test_"))
    return tmp_path_factory.mktemp(name[:8])


@pytest.fixture(scope="session")
def eventually():
    """Return a function that steps until a condition holds, for tests with real sockets."""

    def wait(condition, step, deadline_s=10.0):
        end = time.monotonic() + deadline_s
        while not (result := condition()):
            assert time.monotonic() < end, "did not happen in time"
            step()
            time.sleep(0.002)
        return result

    return wait


@pytest.fixture(scope="session")
def link_config():
    """Return a function that makes link configurations from URLs."""
    return lambda *urls: tuple(LinkConfig(url) for url in urls)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    if collection_path not in ONLY_WHEN_NAMED:
        return None
    named = [Path(config.invocation_params.dir, arg.partition("::")[0]) for arg in config.args]
    return None if any(path.is_relative_to(collection_path) for path in named) else True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests marked `recordings(NAME, ...)` of which a name is not in the folder."""
    folder = recordings_folder()
    for item in items:
        for marker in item.iter_markers("recordings"):
            missing = [str(folder / name) for name in marker.args if not (folder / name).exists()]
            if not folder.is_dir():
                missing = [str(folder)]
            if missing:
                reason = RECORDINGS_MISSING + ", ".join(missing)
                item.add_marker(pytest.mark.skip(reason=reason))


def pytest_collection_finish() -> None:
    """Keep ten thousand tests out of each full garbage collection: it took half a second."""
    gc.freeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name each test that did not run for want of recordings or programs."""
    for report in terminalreporter.stats.get("skipped", []):
        reason = str(report.longrepr[2]) if isinstance(report.longrepr, tuple) else ""
        if MISSING in reason:
            what = reason.removeprefix("Skipped: ")
            terminalreporter.write_line(f"not run, {what}: {report.nodeid}")
