"""What the documents hold to: a short list of changes, and no raw data beside the text."""

import re
from pathlib import Path

import pytest

from tools.take_picture import page_digest, shown_digest

ROOT = Path(__file__).resolve().parents[2]


def test_the_changes_fit_on_a_page_and_each_heading_stands_once():
    lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 60
    headings = [line for line in lines if line.startswith("#")]
    assert len(set(headings)) == len(headings)


def test_the_documents_hold_text_and_pictures_only():
    others = [
        path.name
        for path in (ROOT / "docs").rglob("*")
        if path.is_file() and path.suffix not in {".md", ".png", ".jpg"}
    ]
    assert others == []


def test_the_picture_of_the_page_shows_the_page_as_it_is():
    assert shown_digest() == page_digest(), "the page has changed since: run `make picture`"


LINK = re.compile(r"(?<!`)\[[^\]]*\]\((?!https?:)([^)#\s]*)(?:#([^)\s]+))?\)")
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
PAGES += sorted((ROOT / "docs").rglob("*.md"))


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub gives the headings of a page."""
    headings = HEADING.findall(page.read_text(encoding="utf-8"))
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_a_file_and_a_heading_that_exist(page):
    for target, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        file = (page.parent / target).resolve() if target else page
        assert file.exists(), target
        assert not anchor or anchor in anchors(file), f"{target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_test_that_a_page_names_exists(page):
    named = re.findall(r"`((?:hil_)?tests/[\w/]+\.py)`", page.read_text(encoding="utf-8"))
    assert [name for name in named if not (ROOT / name).exists()] == []
