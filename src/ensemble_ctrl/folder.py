"""The results folder: filled out of sight and then put in its place, so that nothing half-written is ever seen."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex

from ensemble_ctrl.errors import EnsembleError

KINDS = ("trajectories", "controls", "moments", "robustness", "clearance", "certificate")
"""Kinds of pictures that ``ensemble-plan plot`` draws (`ensemble_ctrl.report.plot`)."""
RESULT_FILES = frozenset(
    {
        "certificate.json",
        "controls.csv",
        "controls.png",
        "log.jsonl",
        "online.gif",
        "online.png",
        "outcome.json",
        "routes.png",
        "plan.npz",
        "problem.yaml",
        "provenance.json",
        "report.html",
        "solver.log",
        "spread.png",
        "summary.json",
        "trajectories.png",
        *(f"figure-{kind}.{ending}" for kind in KINDS for ending in ("png", "pdf", "svg")),
        *(f"animation.{ending}" for ending in ("gif", "mp4")),
    }
)
"""What a run, and later commands on its plan may write; ``--overwrite`` leaves a folder with anything else alone."""


class FolderError(EnsembleError):
    """The results folder can't be used; nothing was changed."""


def default_folders(name: str, root: Path = Path("plans")) -> Iterator[Path]:
    """``plans/<name>``, ``plans/<name>-2``, ``-3``, ...: those that do not exist yet."""
    safe = "".join(c if c.isalnum() or c in "._-" else "_" for c in name).strip(".") or "plan"
    folder, n = root / safe, 2
    while True:
        if not os.path.lexists(folder):
            yield folder
        folder, n = root / f"{safe}-{n}", n + 1


class ResultsFolder:
    """A folder to be: files are put into `working`, and `commit` makes it the real one.

    Parameters
    ----------
    target : Path or None
        Where the results belong: a new or an empty folder, or with `overwrite` one of earlier results. None
        is the first free one of `default_folders`.
    name : str
        The plan's name, for that.
    overwrite : bool
        Whether a folder of earlier results may be replaced.

    Raises
    ------
    FolderError
        If the target can't be used; said before any solving.

    Notes
    -----
    `working` is a hidden sibling of the target, or inside of it where the target is there and empty (it may be
    the working directory, or mounted). Either way the files are moved, never copied.
    """

    def __init__(self, target: Path | None, name: str = "plan", overwrite: bool = False) -> None:
        self._free = default_folders(name) if target is None else None
        self.target = next(default_folders(name)) if target is None else target
        try:
            self._place = self.target.resolve()
            self._replaces = _checked(self.target, overwrite)
            self._made = [parent for parent in self._place.parents if not parent.exists()]
            inside = self._place if self._place.is_dir() and not self._replaces else self._place.parent
            inside.mkdir(parents=True, exist_ok=True)
            self.working = inside / f".ensemble-plan-{token_hex(4)}"
            self.working.mkdir()
        except FileExistsError as error:
            raise FolderError(f"{self.target}: can't write results here ({error.filename} is a file)") from None
        except (OSError, ValueError, RuntimeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise FolderError(f"{self.target}: can't write results here ({reason})") from None

    def commit(self) -> Path:
        """Put the results in their place; returns where that is.

        Raises
        ------
        OSError
            If that is not possible; what was there before is there still.
        """
        if self._replaces:
            self._swap()
        elif self.working.parent == self._place:
            for file in self.working.iterdir():
                os.replace(file, self._place / file.name)
            self.working.rmdir()
        else:
            self._rename()
        self._made = []
        return self.target

    def discard(self) -> None:
        """Remove what was written so far, if it is not in its place yet."""
        shutil.rmtree(self.working, ignore_errors=True)
        for parent in self._made:
            with suppress(OSError):
                parent.rmdir()

    def _rename(self) -> None:
        """Move a new folder to its name; to the next free one if another run was quicker."""
        while True:
            try:
                os.rename(self.working, self.target)
                return
            except OSError:
                if self._free is None or not self.target.exists():
                    raise
                self.target = next(self._free)

    def _swap(self) -> None:
        """Replace earlier results."""
        old = self.working.with_name(self.working.name + "-old")
        os.rename(self._place, old)
        try:
            os.rename(self.working, self._place)
        except BaseException:
            os.rename(old, self._place)
            raise
        shutil.rmtree(old, ignore_errors=True)


def _checked(target: Path, overwrite: bool) -> bool:
    """Whether there are earlier results to replace; refuses what may not be touched."""
    if not target.exists():
        return False
    if not target.is_dir():
        raise FolderError(f"{target}: expected a folder for the results, found a file")
    found = sorted(entry.name for entry in target.iterdir())
    if not found:
        return False
    if not overwrite:
        hint = "choose another with -o" + (", or add --overwrite" if "plan.npz" in found else "")
        raise FolderError(f"{target}: this folder is not empty; {hint}")
    if "plan.npz" not in found:
        raise FolderError(f"{target}: --overwrite replaces only folders of earlier results, found no plan.npz here")
    strange = [name for name in found if name not in RESULT_FILES and not name.endswith(".py")]
    if strange:
        raise FolderError(f"{target}: --overwrite would remove {strange[0]}, which is not a result; move it away first")
    if Path.cwd().is_relative_to(target.resolve()):
        raise FolderError(f"{target}: --overwrite can't replace the working directory; run from another folder")
    return True


def write_text(path: Path, text: str, overwrite: bool = False) -> None:
    """Write a file as a whole or not at all.

    Raises
    ------
    FolderError
        If it is there already, unless it may be overwritten, or can't be written.
    """
    if os.path.lexists(path) and not (overwrite and path.is_file()):
        hint = "add --overwrite to replace it" if path.is_file() else "choose another name"
        raise FolderError(f"{path}: this exists already; {hint}")
    with in_place_of(path) as working:
        working.write_text(text, encoding="utf-8")


@contextmanager
def in_place_of(path: Path) -> Iterator[Path]:
    """A path of the same name, out of sight, for what takes the place of `path` once it is complete.

    Raises
    ------
    FolderError
        If it can't be written; what was there before is there still.
    """
    hidden = path.parent / f".ensemble-plan-{token_hex(4)}"
    try:
        hidden.mkdir()
        yield hidden / path.name
        if path.is_dir():
            os.rename(path, hidden / "old")
        os.replace(hidden / path.name, path)
    except OSError as error:
        raise FolderError(f"{path}: can't be written ({error.strerror or error})") from None
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
