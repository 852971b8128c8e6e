"""Take docs/page.png: the page beside a simulated robot on its errand.

The picture names the page that it shows (SHA-256 of its script and style), so that a test can tell
when the page has changed since.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

from PIL import Image, PngImagePlugin

ROOT: Final = Path(__file__).resolve().parent.parent
PICTURE: Final = ROOT / "docs/page.png"
PAGE: Final = "page"
"""Key of the text in the picture that names the page."""
_CHROMIUM: Final = os.environ.get("ROBOTCTL_CHROMIUM", "/usr/bin/chromium")
_DRIVEN_S: Final = 12.0
_COLOURS: Final = 256


def page_digest() -> str:
    """Return what names the page as it is built."""
    static = ROOT / "robotctl/web/static"
    content = b"".join((static / name).read_bytes() for name in ("page.js", "page.css"))
    return hashlib.sha256(content).hexdigest()


def shown_digest() -> str | None:
    """Return what names the page of the picture; None: it names none."""
    with Image.open(PICTURE) as picture:
        digest = picture.info.get(PAGE)
    return None if digest is None else str(digest)


def main() -> int:
    """Drive, and take the picture."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - shown_digest needs none

    robotctl = Path(sys.executable).with_name("robotctl")
    command = [str(robotctl), "sim", "--headless", "--stay", "--web", "127.0.0.1:0"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as sim,
        sync_playwright() as playwright,
    ):
        try:
            assert sim.stdout is not None
            links = (re.search(r"http://\S+", line) for line in sim.stdout)
            link = next(each for each in links if each)[0]
            browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1360, "height": 820})
            page.goto(link)
            page.locator(".state-DRIVING").wait_for()
            page.get_by_role("tab", name="Mission").click()
            page.wait_for_timeout(1e3 * _DRIVEN_S)
            page.screenshot(path=PICTURE)
        finally:
            sim.terminate()
    note = PngImagePlugin.PngInfo()
    note.add_text(PAGE, page_digest())
    with Image.open(PICTURE) as taken:
        small = taken.convert("RGB").quantize(_COLOURS)
    small.save(PICTURE, optimize=True, pnginfo=note)
    return 0


if __name__ == "__main__":
    sys.exit(main())
