"""`robotctl install` and `uninstall`: files on the disk, and a manifest of our files.

Files that others wrote or changed are never overwritten or removed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from robotctl.deploy.service_files import MISSION, ServiceFile
from robotctl.errors import ConfigError
from robotctl.runtime.storage.atomic_file import write_whole

MANIFEST: Final = Path("etc/robotctl/installed.json")


class Manifest(msgspec.Struct, frozen=True):
    """Files of an installation.

    Attributes
    ----------
    files
        SHA-256 of each file, by its path relative to the root.
    folders
        Folders that the installation created, relative to the root.
    """

    files: dict[str, str] = {}
    folders: tuple[str, ...] = ()


def read_manifest(root: Path) -> Manifest:
    """Return the manifest of the installation below `root`; empty without one.

    Raises
    ------
    ConfigError
        If the manifest is damaged.
    """
    path = root / MANIFEST
    try:
        return msgspec.json.decode(path.read_bytes(), type=Manifest)
    except FileNotFoundError:
        return Manifest()
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error


def installed_mission(root: Path) -> Path | None:
    """Return the mission that an earlier installation below `root` wrote; None without one.

    Raises
    ------
    ConfigError
        If the manifest is damaged.
    """
    path = root / MISSION
    return path if str(MISSION) in read_manifest(root).files and path.is_file() else None


def conflicts(files: Sequence[ServiceFile], root: Path) -> list[str]:
    """Return a sentence for each file that others wrote or changed."""
    manifest = read_manifest(root)
    problems = []
    for file in files:
        found = _digest(root / file.path)
        if found is None or found in {_digest_of(file.data), manifest.files.get(str(file.path))}:
            continue
        known = str(file.path) in manifest.files
        what = (
            "was changed since it was installed"
            if known
            else "already exists and was not installed by robotctl"
        )
        problems.append(f"{root / file.path} {what}; move it away first")
    return problems


def install(files: Sequence[ServiceFile], root: Path) -> list[str]:
    """Write the files and the manifest; return a line for each file.

    Raises
    ------
    ConfigError
        If a file of another owner is in the way, before anything is written; or if writing is not
        allowed.
    """
    problems = conflicts(files, root)
    if problems:
        raise ConfigError("\n".join(problems))
    before = read_manifest(root)
    lines = []
    try:
        paths = [*(file.path for file in files), MANIFEST]
        made = [str(folder.relative_to(root)) for folder in _make_folders(paths, root)]
        # A changed file stays the user's, even when reinstalled unchanged.
        wanted = {
            str(file.path): before.files.get(str(file.path), _digest_of(file.data))
            if _change(file, root).startswith("same")
            else _digest_of(file.data)
            for file in files
        }
        # The manifest first, so that an interrupted installation can be undone.
        manifest = Manifest(before.files | wanted, (*before.folders, *made))
        write_whole(root / MANIFEST, msgspec.json.format(msgspec.json.encode(manifest)).decode())
        for file in files:
            lines.append(f"{_change(file, root)}  {root / file.path}")
            if not lines[-1].startswith("same"):
                write_whole(root / file.path, file.data)
        stale = {path: digest for path, digest in before.files.items() if path not in wanted}
        removed, kept = _remove(stale, root)
        manifest = Manifest(wanted | {path: stale[path] for path in kept}, manifest.folders)
        write_whole(root / MANIFEST, msgspec.json.format(msgspec.json.encode(manifest)).decode())
    except OSError as error:
        raise ConfigError(_refusal(error)) from error
    return lines + removed


def uninstall(root: Path, *, dry_run: bool = False) -> tuple[list[str], list[str]]:
    """Remove installed files that are unchanged; a dry run only lists them.

    Returns
    -------
    tuple[list[str], list[str]]
        A line for each file that was removed or gone, and one for each that was kept.

    Raises
    ------
    ConfigError
        If nothing was installed, or removing is not allowed.
    """
    manifest = read_manifest(root)
    if not manifest.files:
        raise ConfigError(f"{root / MANIFEST}: nothing is installed here")
    try:
        lines, kept = _remove(manifest.files, root, dry_run=dry_run)
        if dry_run:
            pass
        elif kept:
            rest = Manifest({path: manifest.files[path] for path in kept}, manifest.folders)
            write_whole(root / MANIFEST, msgspec.json.format(msgspec.json.encode(rest)).decode())
        else:
            (root / MANIFEST).unlink()
            for folder in sorted(manifest.folders, key=len, reverse=True):
                _remove_if_empty(root / folder)
    except OSError as error:
        raise ConfigError(_refusal(error)) from error
    return lines, [f"kept because it was changed: {root / path}" for path in kept]


def _change(file: ServiceFile, root: Path) -> str:
    """Return the effect of installing on a file, in one word."""
    found = _digest(root / file.path)
    if found is None:
        return "new"
    return "same" if found == _digest_of(file.data) else "replaced"


def _remove(
    files: dict[str, str], root: Path, *, dry_run: bool = False
) -> tuple[list[str], list[str]]:
    """Remove the unchanged `files`; return lines for people, and the paths of changed ones."""
    lines, kept = [], []
    for name, digest in files.items():
        path = root / name
        found = _digest(path)
        if found is None:
            lines.append(f"already gone  {path}")
        elif found == digest:
            if not dry_run:
                path.unlink()
            lines.append(f"{'to be removed' if dry_run else 'removed'}  {path}")
        else:
            kept.append(name)
    return lines, kept


def _make_folders(paths: Sequence[Path], root: Path) -> list[Path]:
    """Make the folders of all paths, readable for all; return the new ones, outermost first."""
    made: list[Path] = []
    for path in paths:
        missing = [each for each in (root / path).parents if not each.exists()]
        for folder in reversed(missing):
            folder.mkdir()
            folder.chmod(0o755)
            if folder.is_relative_to(root) and folder != root:
                made.append(folder)
    return made


def _remove_if_empty(folder: Path) -> None:
    """Remove a folder if it exists and is empty."""
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def _digest(path: Path) -> str | None:
    """Return the SHA-256 of a file; None if missing.

    Raises
    ------
    ConfigError
        If it cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error


def _digest_of(data: bytes) -> str:
    """Return the SHA-256 of a file's intended content."""
    return hashlib.sha256(data).hexdigest()


def _refusal(error: OSError) -> str:
    """Return the system's refusal as text."""
    hint = "; run it with sudo" if isinstance(error, PermissionError) else ""
    return f"{error.filename}: {error.strerror}{hint}"
