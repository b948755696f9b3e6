"""Open pages of a built site in headless Chromium: nothing comes from elsewhere, all mathematics is set.

``python docs/try_site.py docs/_build/check`` exits with what is wrong.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.report.browser import Page, chromium, executable  # noqa: E402

TEXT = "document.querySelector('article').innerText"
SET = "document.querySelectorAll('mjx-container').length"
READY = "window.MathJax && MathJax.startup ? MathJax.startup.promise.then(() => true) : true"
RAW = re.compile(r"\\\(|\\\[|\$\$|\\frac|\\sum")
FIRST_SCREEN = (
    "[...document.querySelectorAll('article img, article pre')].slice(0, 3).map(e => e.getBoundingClientRect().bottom)"
)


def wrong(tab: Page, page: Path) -> list[str]:
    """What is wrong with one page."""
    tab.requests.clear()
    tab.complaints.clear()
    tab.open(page)
    tab.run(READY)
    found = [f"{page.name}: asks for {url}" for url in tab.requests if not url.startswith(("file:", "data:"))]
    found += [f"{page.name}: says {text}" for text in tab.complaints]
    if RAW.search(tab.run(TEXT) or ""):
        found.append(f"{page.name}: raw mathematics is left")
    if 'class="math' in page.read_text(encoding="utf-8") and not tab.run(SET):
        found.append(f"{page.name}: no mathematics is set")
    return found


def main(site: Path) -> list[str]:
    """What is wrong with a site."""
    browser = executable()
    if browser is None:
        print("no headless Chromium here: the pages are not opened")
        return ["CI needs a headless Chromium"] if os.environ.get("CI") else []
    found: list[str] = []
    pages = [
        page for page in sorted(site.rglob("*.html")) if "_modules" not in page.parts and "_static" not in page.parts
    ]
    with chromium(browser) as tab:
        tab.screen(1280, 900)
        for page in pages:
            found += wrong(tab, page)
        tab.open(site / "index.html")
        if max(tab.run(FIRST_SCREEN)) > 900:
            found.append("index.html: picture, commands and proof do not fit on the first screen")
    print(f"{len(pages)} pages opened")
    return found


if __name__ == "__main__":
    problems = main(Path(sys.argv[1]))
    sys.exit("\n".join(problems) if problems else 0)
