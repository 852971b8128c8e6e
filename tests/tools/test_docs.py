"""What the documents hold to: a short list of changes, and no raw data beside the text."""

from pathlib import Path

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
