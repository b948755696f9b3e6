"""The results folder: filled out of sight and then put in its place, so that nothing half-written is ever seen."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.core.storage import HIDDEN, claim, exchange, hidden_name, hold, put_file, release, sweep
from ensemble_ctrl.files.config import named_source

WRITTEN = frozenset(
    {
        "box.png",
        "certificate.json",
        "controls.csv",
        "controls.png",
        "log.jsonl",
        "online.gif",
        "online.png",
        "outcome.json",
        "routes.png",
        "plan.npz",
        "proof_input.json",
        "problem.yaml",
        "provenance.json",
        "report.html",
        "solver.log",
        "spread.png",
        "summary.json",
        "trajectories.png",
        "widest.json",
        *(f"animation.{ending}" for ending in ("gif", "mp4")),
    }
)
"""What a run, and later commands on its plan may write, but for the pictures of ``ensemble-plan plot``."""
COMPARED = frozenset({"compare.json", "compare.png"})
"""What a comparison writes."""
CHANNELS = frozenset({"channels.json", "channels.png", "curve.png"})
"""What a search for channels writes, beside a folder of results for each."""
CHANNEL = re.compile(r"channel-[1-9]\d*")
"""Names of these folders."""


def result_files() -> frozenset[str]:
    """What a run, and later commands on its plan may write; ``--overwrite`` spares a folder with anything else."""
    from ensemble_ctrl.report.canvas import FORMATS
    from ensemble_ctrl.report.plot import KINDS

    pictures = (f"figure-{kind}.{ending}" for kind in KINDS for ending in FORMATS)
    return WRITTEN.union(pictures)


class FolderError(EnsembleError):
    """The results folder can't be used; nothing was changed."""


def default_folders(name: str, root: Path = Path("plans")) -> Iterator[Path]:
    """``plans/<name>``, ``plans/<name>-2``, ``-3``, ...: those that do not exist yet."""
    safe = "".join(c if c.isalnum() or c in "._-" else "_" for c in name).strip(".") or "plan"
    return _free(root / safe)


def _free(folder: Path) -> Iterator[Path]:
    """A folder, then the same with ``-2``, ``-3``, ... behind its name: those that do not exist yet."""
    numbered, n = folder, 2
    while True:
        if not os.path.lexists(numbered):
            yield numbered
        numbered, n = folder.with_name(f"{folder.name}-{n}"), n + 1


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
        If the target can't be used, or another process is about to write there; raised before any solving.

    Notes
    -----
    `working` is a hidden sibling of the target, or inside of it where the target is there and empty (it may be
    the working directory, or mounted). Either way the files are moved, never copied. Its name follows from the
    target's, and it is locked as long as this process lives: that is how another one sees that the place is taken.
    What a process that was killed has left is removed by the next one that writes into the same place.
    """

    def __init__(self, target: Path | None, name: str = "plan", overwrite: bool = False) -> None:
        self._held: int | None = None
        self._committed = False
        candidates = default_folders(name) if target is None else iter([target])
        for self.target in candidates:
            try:
                self._take(overwrite)
                return
            except BlockingIOError:
                self._give_up()
            except FolderError:
                if target is not None:
                    raise  # else another run was quicker: the next number
            except FileExistsError as error:
                self._give_up()
                reason = f"{error.filename} is a file"
                raise FolderError(f"{self.target}: can't write results here ({reason})") from None
            except (OSError, ValueError, RuntimeError) as error:
                self._give_up()
                reason = getattr(error, "strerror", None) or str(error)
                raise FolderError(f"{self.target}: can't write results here ({reason})") from None
        raise FolderError(f"{self.target}: another run is about to write its results here; choose another with -o")

    def _take(self, overwrite: bool) -> None:
        """Make sure that the results can be put in their place, and that nobody else will do so."""
        self._made: list[Path] = []
        self._committed = False
        self._place = self.target.resolve()
        replaces = _checked(self.target, overwrite)
        self._made = [parent for parent in self._place.parents if not parent.exists()]
        inside = self._place if self._place.is_dir() and not replaces else self._place.parent
        inside.mkdir(parents=True, exist_ok=True)
        digest = hashlib.sha256(os.fsencode(self._place.name)).hexdigest()
        self.working = inside / f".ensemble-plan-{digest[:12]}"
        self._held = claim(self.working)
        try:
            self._recover()
            self._replaces = _checked(self.target, overwrite)  # by now another run may have ended
        except BaseException:
            self.discard()
            raise
        sweep(inside)

    def commit(self) -> Path:
        """Put the results in their place; returns where that is.

        If something else has appeared there in the meantime, they go to the same name with ``-2``, ``-3``, ...

        Raises
        ------
        OSError
            If that is not possible; what was there before is there still.
        """
        if self._committed:
            return self.target
        if self._replaces and self._still_replaceable():
            _replace(self._place, self.working, self._old)
        elif self.working.parent == self._place and self._fits_inside():
            for file in self.working.iterdir():
                os.replace(file, self._place / file.name)
            self.working.rmdir()
        else:
            self._rename()
        self._committed = True
        release(self._held)
        return self.target

    def discard(self) -> None:
        """Remove what was written so far, if it is not in its place yet."""
        if self._committed:
            return
        shutil.rmtree(self.working, ignore_errors=True)
        self._give_up()

    def _give_up(self) -> None:
        """Leave the place to others."""
        release(self._held)
        self._held, self._committed = None, True
        for parent in self._made:
            with suppress(OSError):
                parent.rmdir()

    def _fits_inside(self) -> bool:
        """Whether no file of the results has appeared in their place in the meantime."""
        return not any(os.path.lexists(self._place / file.name) for file in self.working.iterdir())

    def _still_replaceable(self) -> bool:
        """Whether earlier results, and nothing else, are in the place."""
        try:
            return _checked(self.target, overwrite=True)
        except FolderError:
            return False

    def _rename(self) -> None:
        """Move a new folder to its name; to the next free one if something else is there by now."""
        others = _free(self.target)
        while True:
            try:
                os.rename(self.working, self._place)
                return
            except OSError:
                if not os.path.lexists(self._place):
                    raise
                self.target = next(others)
                self._place = self.target.resolve()

    def _recover(self) -> None:
        """Put back earlier results that a killed process was about to replace, or remove what it had replaced."""
        if not self._old.is_dir():
            return
        if os.path.lexists(self._place):
            shutil.rmtree(self._old)
        else:
            os.rename(self._old, self._place)

    @property
    def _old(self) -> Path:
        """Where earlier results are between two renames."""
        return self.working.with_name(f"{self.working.name}-old")


def _replace(place: Path, new: Path, old: Path) -> None:
    """Put one folder in the place of another and remove that.

    Where the system can exchange them, either is there at every instant; else the former one is `old` for an instant.
    """
    held = hold(place)
    try:
        exchange(new, place)
    except OSError:
        _replace_in_two_steps(place, new, old)
    else:
        shutil.rmtree(new, ignore_errors=True)
    finally:
        release(held)


def _replace_in_two_steps(place: Path, new: Path, old: Path) -> None:
    """The same by two renames; if the second fails, what was there is there again."""
    os.rename(place, old)
    try:
        os.rename(new, place)
    except BaseException:
        os.rename(old, place)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _checked(target: Path, overwrite: bool) -> bool:
    """Whether there are earlier results to replace; refuses what may not be touched."""
    if not target.exists():
        return False
    if not target.is_dir():
        raise FolderError(f"{target}: expected a folder for the results, found a file")
    found = sorted(entry.name for entry in target.iterdir() if not HIDDEN.fullmatch(entry.name))
    if not found:
        return False
    results = {"plan.npz": result_files(), "compare.json": COMPARED, "channels.json": CHANNELS}
    known = next((names for mark, names in results.items() if mark in found), None)
    if not overwrite:
        hint = "choose another with -o" + ("" if known is None else ", or add --overwrite")
        raise FolderError(f"{target}: this folder is not empty; {hint}")
    if known is None:
        raise FolderError(f"{target}: --overwrite replaces only folders of earlier results, found no plan.npz here")
    strange = next((name for name in found if not _is_result(target / name, known)), None)
    if strange is not None:
        raise FolderError(f"{target}: --overwrite would remove {strange}, which is not a result; move it away first")
    if Path.cwd().is_relative_to(target.resolve()):
        raise FolderError(f"{target}: --overwrite can't replace the working directory; run from another folder")
    return True


def _is_result(path: Path, known: frozenset[str]) -> bool:
    """Whether a run wrote this: a file of its own, or the Python file that its problem names, with Python's cache."""
    if path.is_symlink():
        return False
    if path.is_dir() and known is CHANNELS:
        return CHANNEL.fullmatch(path.name) is not None and all(_is_result(f, result_files()) for f in path.iterdir())
    if path.is_dir():
        source = named_source(path.with_name("problem.yaml"))
        return path.name == "__pycache__" and source is not None and _caches_only(path, source)
    return path.name in known or path.name == named_source(path.with_name("problem.yaml"))


def _caches_only(folder: Path, source: str) -> bool:
    """Whether a folder holds nothing but Python's cache of one file."""
    stem = source.removesuffix(".py")
    return all(entry.name.startswith(f"{stem}.") and entry.suffix == ".pyc" for entry in folder.iterdir())


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A path of the same name, out of sight, for a folder that takes the place of `path` once it is complete.

    Raises
    ------
    FolderError
        If it can't be written; what was there before is there still.
    """
    hidden = path.parent / hidden_name()
    held = None
    try:
        sweep(path.parent)
        held = claim(hidden)
        yield hidden / path.name
        if os.path.lexists(path):
            _replace(path, hidden / path.name, hidden.with_name(f"{hidden.name}-old"))
        else:
            os.rename(hidden / path.name, path)
    except OSError as error:
        raise FolderError(f"{path}: can't be written ({error.strerror or error})") from None
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
        release(held)


def require_free(path: Path, overwrite: bool) -> None:
    """Refuse the name of a file that is there, unless it may be replaced, or is one of a results folder's own.

    Raises
    ------
    FolderError
    """
    own = path.name in result_files() and (path.parent / "plan.npz").is_file()
    if os.path.lexists(path) and not (overwrite or own):
        raise _taken(path)


def write_text(path: Path, text: str, overwrite: bool = False) -> None:
    """Write a file as a whole or not at all.

    Raises
    ------
    FolderError
        If it is there already, unless it may be overwritten, or can't be written.
    """
    try:
        put_file(path, text, new=not (overwrite and path.is_file()))
    except FileExistsError:
        raise _taken(path) from None
    except OSError as error:
        raise FolderError(f"{path}: can't be written ({error.strerror or error})") from None


def _taken(path: Path) -> FolderError:
    """The message about a name that is taken."""
    hint = "add --overwrite to replace it" if path.is_file() else "choose another name"
    return FolderError(f"{path}: this exists already; {hint}")
