"""Runs on the workers of a Dask scheduler, checked before the first run; the extra `campaign`."""

from __future__ import annotations

import functools
import hashlib
import logging
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, TypeAlias

import msgspec

from robotctl.errors import ConfigError, RobotctlError
from robotctl.workbench.campaign.alone import Ending, Program, run_alone, stop_runs
from robotctl.workbench.campaign.engine import Workers
from robotctl.workbench.campaign.plan import sources_fingerprint
from robotctl.workbench.compile.compile import Kernels

_PATIENCE_S: Final = 10.0
"""Time in which a scheduler answers [s]."""
_PACKAGES: Final = ("numpy", "scipy", "numba", "msgspec")
"""Packages on which the figures of a run depend."""
_RETRIES: Final = 2
"""Times that a run whose worker was lost is begun again on another."""

Digests: TypeAlias = Mapping[str, str]
"""Hash of each file, by its path."""


class Identity(msgspec.Struct, frozen=True):
    """Versions and files of one computer on which the figures of a run depend.

    Attributes
    ----------
    robotctl
        Version and sources of robotctl.
    others
        Versions of Python and of other packages, and the kind of processor.
    wrong_files
        Files of the campaign that are missing there, or have another content.
    """

    robotctl: str
    others: tuple[str, ...]
    wrong_files: tuple[str, ...] = ()


def identity(files: Digests) -> Identity:
    """Return the identity of this process; `files`: those of a campaign."""
    wrong = tuple(path for path, digest in files.items() if _digest(Path(path)) != digest)
    others = (
        f"Python {platform.python_version()}",
        *(f"{each} {version(each)}" for each in _PACKAGES),
    )
    return Identity(
        f"{version('robotctl')}, sources {own_sources()[:12]}", (*others, platform.machine()), wrong
    )


def digests(files: Sequence[Path]) -> dict[str, str]:
    """Return the hashes of files."""
    return {str(path): _digest(path) for path in files}


def _digest(path: Path) -> str:
    """Return the hash of a file; empty if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


own_sources = functools.cache(sources_fingerprint)


def run_as(
    owner: str, sources: str, program: Program, words: Sequence[str], wall_seconds: float
) -> Ending:
    """Run as `run_alone`, unless this worker, which may have come later, has other sources."""
    if own_sources() != sources:
        return Ending(reason="its worker has another robotctl, and came after the check of all")
    from distributed import get_worker  # noqa: PLC0415 - an extra

    ending = run_alone(program, words, wall_seconds, owner)
    return msgspec.structs.replace(ending, worker=get_worker().address)


@contextmanager
def cluster_workers(address: str, files: Sequence[Path]) -> Iterator[Workers]:
    """Yield the workers of a scheduler.

    Parameters
    ----------
    address
        The scheduler: `tcp://HOST:PORT`.
    files
        Files of the campaign, which each worker needs under the same path.

    Raises
    ------
    ConfigError
        If the extra is not installed, no scheduler answers, it has no workers, or one of them
        would drive other runs than this computer; with a line for each.
    """
    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ConfigError(
            "--scheduler needs Dask, which is not installed; install it with\n"
            "  sudo /opt/robotctl/bin/pip install '/opt/robotctl-source[campaign]'\n"
            "where these are the installation and your copy of robotctl (in a checkout: make setup)"
        ) from error
    client = _connected(Client, address)
    try:
        count = _checked(client, address, files)
        executor = client.get_executor(pure=False, retries=_RETRIES)
        owner = client.id
        run = functools.partial(run_as, owner, own_sources())

        def dismiss(worker: str) -> bool:
            if not client.nthreads().keys() - {worker}:
                return False
            client.retire_workers([worker], close_workers=True)
            return True

        def lost() -> str:
            return "" if client.nthreads() else f"{address}: has no workers any more"

        try:
            yield Workers(executor, count, run, dismiss, lost=lost)
        except BaseException:
            executor.shutdown(wait=False)
            with suppress(OSError):  # the scheduler may be lost
                client.run(stop_runs, owner, on_error="ignore")
            raise
    finally:
        client.close()


def _connected(make: Callable[..., Any], address: str) -> Any:
    """Return a client of a scheduler; raises ConfigError if none answers, or one of other kind."""
    # What Dask logs of a scheduler that is not there, or of workers that come and go, is said here.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = make(address, timeout=_PATIENCE_S, set_as_default=False)
        theirs = client.get_versions(check=False)["scheduler"]["packages"]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ConfigError(
            f"--scheduler {address}: no scheduler of Dask answers there: {error}; "
            "`dask scheduler` starts one"
        ) from error
    ours = {"distributed": version("distributed"), "dask": version("dask")}
    for name, own in ours.items():
        if theirs.get(name) != own:
            client.close()
            raise ConfigError(
                f"--scheduler {address}: has {name} {theirs.get(name)}, this computer {own}; "
                "both need the same"
            )
    return client


def _checked(client: Any, address: str, files: Sequence[Path]) -> int:
    """Return how many runs the workers take at a time, once all are found to be fit."""
    threads: Mapping[str, int] = client.nthreads()
    if not threads:
        raise ConfigError(
            f"--scheduler {address}: has no workers; `dask worker {address}` starts one"
        )
    known = digests(files)
    theirs = client.run(identity, known, on_error="return")
    if problems := [*unfit(identity(known), theirs)]:
        raise ConfigError("\n".join(f"--scheduler {address}: {each}" for each in problems))
    hosts = {worker.rpartition(":")[0]: worker for worker in threads}
    failed = client.run(compile_kernels, workers=[*hosts.values()])
    if problems := [f"worker {worker}: {why}" for worker, why in failed.items() if why]:
        raise ConfigError("\n".join(f"--scheduler {address}: {each}" for each in problems))
    return sum(threads.values())


def unfit(ours: Identity, theirs: Mapping[str, Any]) -> Iterator[str]:
    """Yield what makes workers unfit; `theirs`: by address the identity, or why there is none."""
    for worker, found in sorted(theirs.items()):
        if not isinstance(found, Identity):
            yield f"worker {worker}: has no robotctl like this one: {found}"
            continue
        if found.robotctl != ours.robotctl:
            yield f"worker {worker}: has robotctl {found.robotctl}, this computer {ours.robotctl}"
        for own, other in zip(ours.others, found.others, strict=True):
            if own != other:
                yield f"worker {worker}: has {other}, this computer {own}"
        for path in found.wrong_files:
            yield f"worker {worker}: {path}: is missing there, or is another file"


def compile_kernels() -> str:
    """Compile the kernels for this computer if they are not; return why that failed."""
    kernels = Kernels(simulated=True)
    if not kernels.missing:
        return ""
    try:
        kernels.compile()
    except RobotctlError as error:
        return str(error)
    return ""
