"""The documents as a site: every link leads somewhere, and a page needs nothing of another host."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LOADED = re.compile(
    r'(?:\bsrc="|<link[^>]*\bhref=")(https?:[^"]*)"|@import[^;]*https?:|url\(["\']?https?:'
)
"""Scripts, pictures, fonts and styles that a browser would fetch elsewhere."""
COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def build(folder: Path) -> subprocess.CompletedProcess[str]:
    """Build the site of a copy of the documents."""
    command = (Path(sys.executable).parent / "zensical", "build", "--strict", "-f", "zensical.toml")
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(ROOT / "docs", folder / "docs")
    shutil.copy(ROOT / "zensical.toml", folder)
    (folder / "robotctl").symlink_to(ROOT / "robotctl")
    return folder


def test_the_site_is_built_without_a_warning_and_loads_nothing_from_elsewhere(copy):
    built = build(copy)
    assert built.returncode == 0, built.stdout + built.stderr
    pages = [*(copy / "build" / "site").rglob("*.html")]
    assert len(pages) >= len([*(ROOT / "docs").rglob("*.md")])
    for page in (*pages, *(copy / "build" / "site").rglob("*.css")):
        assert LOADED.search(page.read_text(encoding="utf-8")) is None, page
    reference = (copy / "build" / "site" / "reference" / "control.html").read_text("utf-8")
    assert "Gains in use." in reference  # a docstring


def test_a_link_to_a_heading_that_is_not_there_fails(copy):
    page = copy / "docs" / "tutorial.md"
    text = page.read_text(encoding="utf-8")
    page.write_text(f"{text}\n[nowhere](safety.md#no-such-heading)\n", encoding="utf-8")
    try:
        built = build(copy)
    finally:
        page.write_text(text, encoding="utf-8")
    assert built.returncode != 0
    assert "no-such-heading" in COLOUR.sub("", built.stdout + built.stderr)
