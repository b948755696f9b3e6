"""Write the pictures of ``docs/editor.md``: the editor on a wide screen, in dark colours, and on a phone.

``python docs/make_editor.py`` needs a headless Chromium and the extra ``edit``.
"""

from __future__ import annotations

import io
import shutil
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.edit.editor import editor  # noqa: E402
from tests.report.browser import Page, chromium, executable  # noqa: E402

STATIC = ROOT / "docs" / "_static"
SHOWN = "document.documentElement.dataset"
READY = (
    f"window.editor && {SHOWN}.fresh === 'yes' && {SHOWN}.phase === 'idle'"
    " && !editor.changes.busy && editor.map.dragged === null"
)
O3 = (
    "(() => { const r = document.querySelector('[data-name=o3] polygon').getBoundingClientRect();"
    " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
)


def wait(tab: Page) -> None:
    """Until the plan of what is shown is there."""
    end = time.monotonic() + 120
    while not tab.run(READY):
        if time.monotonic() > end:
            raise SystemExit("the editor has no plan after 120 s")
        time.sleep(0.1)
    time.sleep(0.3)


def keep(tab: Page, name: str) -> None:
    """The window as a picture in few colours."""
    picture = Image.open(io.BytesIO(tab.picture())).convert("RGB")
    picture.quantize(200, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(STATIC / name, optimize=True)
    print(f"wrote {STATIC / name}")


def main() -> None:
    """Make all three."""
    browser = executable()
    if browser is None:
        raise SystemExit("no headless Chromium here")
    with TemporaryDirectory() as folder:
        file = Path(shutil.copy(ROOT / "configs" / "five_obstacles.yaml", folder))
        with editor(file) as one, chromium(browser) as tab:
            tab.screen(1280, 900)
            tab.visit(one.address)
            wait(tab)
            place = tab.run(O3)
            tab.drag((place[0], place[1]), (place[0] + 40, place[1] - 20))
            wait(tab)
            tab.run("document.getElementById('time').value = 620; document.getElementById('time').oninput()")
            keep(tab, "editor.png")
            tab.screen(1280, 900, dark=True)
            tab.run("document.querySelector('[data-tab=proof]').click()")
            wait(tab)
            keep(tab, "editor_dark.png")
            tab.screen(390, 800)
            tab.run("document.querySelector('[data-tab=task]').click()")
            wait(tab)
            keep(tab, "editor_phone.png")


if __name__ == "__main__":
    main()
