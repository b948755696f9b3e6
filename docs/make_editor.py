"""Write the pictures of ``docs/editor.md``: the editor, wide, dark and on a phone, and pages that are looked at.

``python docs/make_editor.py`` needs a headless Chromium and the extra ``edit``.
"""

from __future__ import annotations

import io
import json
import shutil
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import ensemble_ctrl as ec  # noqa: E402
from tests.edit.editor import editor, served  # noqa: E402
from tests.edit.test_notebook import notebook  # noqa: E402
from tests.report.browser import Page, chromium, executable  # noqa: E402

STATIC = ROOT / "docs" / "_static"
SHOWN = "document.documentElement.dataset"
READY = (
    f"window.editor && {SHOWN}.fresh === 'yes' && {SHOWN}.phase === 'idle'"
    " && !editor.changes.busy && editor.map.dragged === null"
)
O4_AWAY = "obstacles.o4={box: [[1.0, 2.0], [3.9, 5.1]]}"
O3 = (
    "(() => { const r = document.querySelector('[data-name=o3] polygon').getBoundingClientRect();"
    " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
)


def wait(tab: Page, ready: str = READY) -> None:
    """Until the plan of what is shown is there."""
    end = time.monotonic() + 120
    while not tab.run(ready):
        if time.monotonic() > end:
            raise SystemExit("the editor has no plan after 120 s")
        time.sleep(0.1)
    time.sleep(0.3)


def keep(tab: Page, name: str) -> None:
    """The window as a picture in few colours."""
    picture = Image.open(io.BytesIO(tab.picture())).convert("RGB")
    picture.quantize(200, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(STATIC / name, optimize=True)
    print(f"wrote {STATIC / name}")


def view(browser: str, folder: Path) -> None:
    """Two plans over each other."""
    problem = ec.load(ROOT / "configs" / "five_obstacles.yaml")
    wider = ec.load(ROOT / "configs" / "five_obstacles.yaml", overrides=["fleet.radius=10 cm", O4_AWAY])
    for name, one in (("five_obstacles", problem), ("wider", wider)):
        (folder / name).mkdir()
        ec.plan(one).save(folder / name / "plan.npz")
    with served("view", str(folder / "five_obstacles"), str(folder / "wider")) as one, chromium(browser) as tab:
        tab.screen(1280, 900)
        tab.visit(one.address)
        wait(tab, "document.querySelectorAll('#map .path').length === 30")
        tab.run("document.querySelector('label.note input').click()")
        tab.run("document.getElementById('time').value = 560; document.getElementById('time').oninput()")
        keep(tab, "editor_view.png")


def watch(browser: str, folder: Path) -> None:
    """A search and a loop at their ends."""
    search = ["run", str(ROOT / "configs" / "five_obstacles.yaml")]
    loop = ["online", str(ROOT / "configs" / "online" / "three_robots_online.yaml")]
    for name, command in (("editor_search.png", search), ("editor_loop.png", loop)):
        options = ("--watch", "--no-plots", "-o", str(folder / name))
        with served(*command, *options, said_in="stderr") as one, chromium(browser) as tab:
            tab.screen(1280, 900)
            tab.visit(one.address)
            wait(tab, "window.editor && editor.part.done === true")
            keep(tab, name)


SEEN = (
    "(() => { const s = editor.map.sides[0], r = s.svg.getBoundingClientRect(), p = s.at([%s]);"
    " return [r.x + p[0], r.y + p[1]]; })()"
)


def space(browser: str, folder: Path) -> None:
    """A quadrotor from above and from the side, with its goal selected."""
    file = Path(shutil.copy(ROOT / "configs" / "systems" / "quadrotor_climb.yaml", folder))
    with editor(file) as one, chromium(browser) as tab:
        tab.screen(1280, 900)
        tab.visit(one.address)
        wait(tab)
        place = tab.run(SEEN % "12, 70")
        tab.click(place[0], place[1])
        tab.run("document.getElementById('time').value = 560; document.getElementById('time').oninput()")
        wait(tab)
        keep(tab, "editor_space.png")


CELL = """<body style="margin:24px;font:15px system-ui"><pre style="background:#f2f3f5;padding:10px;border-radius:6px">
page = ec.edit(ec.example("five_obstacles"))
page</pre>"""


def in_notebook(browser: str, _: Path) -> None:
    """The editor below a cell."""
    with notebook(CELL) as page, chromium(browser) as tab:
        one = ec.edit(ec.load(ROOT / "configs" / "five_obstacles.yaml"), page=page, height=820)
        tab.screen(1180, 960)
        tab.visit(page)
        tab.run(f"document.body.insertAdjacentHTML('beforeend', {json.dumps(one._repr_html_())})")
        time.sleep(12)  # of a frame from elsewhere nothing can be asked
        keep(tab, "editor_notebook.png")
        one.close()


def main() -> None:
    """Make all of them."""
    browser = executable()
    if browser is None:
        raise SystemExit("no headless Chromium here")
    with TemporaryDirectory() as folder:
        view(browser, Path(folder))
        watch(browser, Path(folder))
        in_notebook(browser, Path(folder))
        space(browser, Path(folder))
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
