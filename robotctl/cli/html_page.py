"""Pages for a browser: one file of HTML that loads nothing."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Final

_STYLE: Final = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2rem; }
img { width: 100%; border-radius: 6px; background: #fff; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: 0.2rem 0.8rem 0.2rem 0; vertical-align: top; }
tr { border-bottom: 1px solid #8884; }
td.time { font-variant-numeric: tabular-nums; white-space: nowrap; }
.score { columns: 2 22rem; } .score div { display: flex; gap: 1rem; break-inside: avoid; }
.score span { flex: 1; opacity: 0.75; } .score b { flex: 1; font-weight: 600; }
.warning td { color: #b26a00; } .error td, .fatal td { color: #c62828; font-weight: 600; }
@media (prefers-color-scheme: dark) {
  .warning td { color: #ffb74d; } .error td, .fatal td { color: #ff8a80; }
}
"""


def document(title: str, parts: Iterable[str]) -> str:
    """Return a page of parts in HTML, below its title."""
    body = "\n".join((f"<h1>{html.escape(title)}</h1>", *parts))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head>\n"
        f"<body>\n{body}\n</body></html>\n"
    )
