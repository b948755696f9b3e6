"""Occupancy grids as robots make them: ``map.yaml`` beside a PGM or PNG image, as ROS map servers read them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.cells import Cells
from ensemble_ctrl.core.storage import read_regular
from ensemble_ctrl.files.config.errors import FieldError, is_number, show
from ensemble_ctrl.files.config.source import checked_path
from ensemble_ctrl.files.config.tree import TextError, Tree, start

MAX_CELLS = 16_000_000
LARGEST = 1e6
MAX_IMAGE_BYTES = 100_000_000
FREE, OCCUPIED = 0.196, 0.65
"""Thresholds of a map that gives none."""
GREY, EXACT = 205 / 255, 1e-6
"""What ``map_saver`` writes for unknown cells, of 1, and how exactly."""
Unknown = Literal["occupied", "free"]
EXAMPLE = "for example  image: office.pgm, resolution: 0.05, origin: [-10, -10, 0]"


def read_occupancy(path: Path, text: str, unknown: Unknown | None = None) -> tuple[Cells, tuple[str, ...]]:
    """The grid that a map file and its image describe, and what its reader should know of how it was read.

    Parameters
    ----------
    path : Path
        Of the map file; the image is in its folder or below.
    text : str
        What is in the map file.
    unknown : {"occupied", "free"}, optional
        What the cells are that no scan has seen; occupied if not given, and then there is a note where the map's own
        thresholds would have them free.

    Returns
    -------
    cells : Cells
    notes : tuple of str

    Raises
    ------
    TextError
        If a field is missing or wrong, the image can't be read, or none of its cells is free.

    Notes
    -----
    A cell is occupied if its occupancy is above ``occupied_thresh``, free if not and below ``free_thresh``, and else
    unknown, as are cells with any transparency and those of exactly the grey 205 by which ``map_saver`` writes
    unknown ones, whatever the thresholds make of it. Of a coloured cell the most occupied channel counts.
    """
    tree = Tree.read(text)
    fields = _Fields(tree, tree.data if isinstance(tree.data, dict) else {})
    size = fields.number("resolution", above=0.0)
    x, y, yaw = fields.numbers("origin", 3)
    free, occupied = fields.threshold("free_thresh", FREE), fields.threshold("occupied_thresh", OCCUPIED)
    negate = bool(fields.choice("negate", (0, 1, False, True), 0))
    raw = fields.choice("mode", ("trinary", "scale", "raw"), "trinary") == "raw"
    for key, values in (("resolution", [size]), ("origin", [x, y, yaw])):
        if max(map(abs, values)) > LARGEST:
            raise fields.wrong(key, f"expected at most {LARGEST:g}, got {max(values, key=abs):g}")
    name = fields.text("image")
    try:
        pixels, opaque = _pixels(checked_path(path.parent, name))
    except FieldError as error:
        raise fields.wrong("image", error.message, error.hint) from None
    # ROS map_server: free below free_thresh, occupied above occupied_thresh, else unknown; so is map_saver's grey 205
    occupancy = _raw(pixels) if raw else _occupancy(pixels, negate)
    # free cells; transparent ones are unknown
    below = opaque & (occupancy < free) & (occupancy <= occupied)
    grey = opaque & (np.abs(pixels - GREY).max(axis=2) < EXACT) if not (negate or raw) else np.zeros_like(opaque)
    unseen = ~opaque | grey | (~below & (occupancy <= occupied)) | (occupancy > 1)
    taken = ~below & ~unseen if unknown == "free" else ~below | unseen
    if taken.all():
        raise fields.wrong("free_thresh", *_nothing_free(pixels, occupancy, opaque, free))
    return Cells(taken[::-1], size, (x, y), yaw), tuple(_notes(unknown, int(unseen.sum()), int((grey & below).sum())))


def _notes(unknown: Unknown | None, unseen: int, freed: int) -> Iterator[str]:
    """Remarks on the cells that no scan has seen."""
    if unknown == "free" and unseen:
        yield f"{unseen:,} unknown cells count as free: what stands there is not known, and no proof is about it"
    if unknown is None and freed:
        thresholds = "its free_thresh would have them free"
        ways = "write  unknown: free  to pass through them, or  unknown: occupied  to leave it at that"
        yield f"{freed:,} cells of the grey 205 (unknown) count as occupied, though {thresholds}; {ways}"


def _nothing_free(
    pixels: NDArray[np.float32], occupancy: NDArray[np.float32], opaque: NDArray[np.bool_], free: float
) -> tuple[str, str]:
    """Why no cell is free, and what to do about it."""
    if not opaque.any():
        return "no cell of the image is free: all have some transparency", "write it without transparency"
    least = float(occupancy[opaque].min())
    if pixels.shape[2] > 1 and float((1 - pixels.mean(axis=2))[opaque].min()) < free:
        why = "of a coloured cell the darkest channel counts"
        return f"no cell of the image is free: {why}, and the least occupancy is {least:.3f}", "write the image in grey"
    if least < free:
        return "no cell of the image is free: all that are below it are unknown (the grey 205)", "see unknown: free"
    hint = f"raise it above {least:.3f}" if least < OCCUPIED else "negate: 1 is for images whose free cells are dark"
    return f"no cell of the image is free: the least occupancy is {least:.3f}, this is {free:g}", hint


class _Fields:
    """The fields of a map file."""

    def __init__(self, tree: Tree, data: dict[str, Any]) -> None:
        self._tree, self._data = tree, data

    def wrong(self, key: str, message: str, hint: str = "") -> TextError:
        """What is wrong with a field, at its place."""
        node = self._tree.values.get((key,))
        return TextError(f"{key}: {message}", start(node) if node is not None else None, hint)

    def number(self, key: str, above: float = -math.inf, default: float | None = None) -> float:
        """A finite number."""
        value: Any = self._data.get(key, default)
        if not is_number(value) or value <= above:
            wanted = "a finite number" if above == -math.inf else f"a finite number above {above:g}"
            raise self.wrong(key, f"expected {wanted}, got {show(value)}", "" if key in self._data else EXAMPLE)
        return float(value)

    def threshold(self, key: str, default: float) -> float:
        """A share of a cell, 0 to 1."""
        value = self.number(key, default=default)
        if not 0 <= value <= 1:
            hint = f"write {value / 100:g}, if percent is meant" if 1 < value <= 100 else ""
            raise self.wrong(key, f"expected 0 to 1, got {value:g}", hint)
        return value

    def numbers(self, key: str, count: int) -> list[float]:
        """A list of finite numbers."""
        value = self._data.get(key)
        if not isinstance(value, list) or len(value) != count or not all(map(is_number, value)):
            turned = isinstance(value, list) and len(value) == count and all(map(is_number, value[:2]))
            hint = "write 0 as its yaw, unless the map is turned" if turned else ""
            raise self.wrong(key, f"expected [x, y, yaw], got {show(value)}", hint if key in self._data else EXAMPLE)
        return [float(item) for item in value]

    def text(self, key: str) -> str:
        """A text."""
        value = self._data.get(key)
        if not isinstance(value, str) or not value:
            raise self.wrong(key, f"expected the name of a file, got {show(value)}", EXAMPLE)
        return value

    def choice(self, key: str, known: tuple[Any, ...], default: Any) -> Any:
        """One of a few values."""
        value = self._data.get(key, default)
        if isinstance(value, dict | list) or value not in known:
            listed = ", ".join(str(item) for item in known if not isinstance(item, bool))
            raise self.wrong(key, f"expected one of {listed}, got {show(value)}")
        return value


def _occupancy(pixels: NDArray[np.float32], negate: bool) -> NDArray[np.float32]:
    """How occupied each cell is, 0 to 1, shape (rows, columns), the top row first."""
    return np.asarray(pixels.max(axis=2) if negate else 1 - pixels.min(axis=2))


def _raw(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same where pixels are percents of occupancy; above 1 where they are none: unknown."""
    return np.asarray(np.rint(255 * pixels.max(axis=2)) / np.float32(100), dtype=np.float32)


def _pixels(path: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The channels of an image, 0 to 1, shape (rows, columns, channels), and which of its pixels are opaque."""
    from PIL import Image, UnidentifiedImageError

    try:
        content = read_regular(path, MAX_IMAGE_BYTES)
        if len(content) > MAX_IMAGE_BYTES:
            raise FieldError(f"{path.name}: expected an image of at most {MAX_IMAGE_BYTES // 1_000_000} MB, got more")
        with _opened(content) as image:
            if image.width * image.height > MAX_CELLS:
                raise _too_large(path, f"{image.width} x {image.height}")
            return _channels(image)
    except FileNotFoundError:
        raise FieldError(f"{path.name}: no such file") from None
    except UnidentifiedImageError:
        raise FieldError(f"{path.name}: expected an image in PGM or PNG") from None
    except Image.DecompressionBombError:
        raise _too_large(path, "many more") from None
    except (OSError, ValueError, SyntaxError, EOFError, MemoryError) as error:
        raise FieldError(
            f"{path.name}: this image can't be read: {getattr(error, 'strerror', None) or error}"
        ) from None


def _opened(content: bytes) -> Any:
    """An image of which nothing but the head is read; its size is checked here, so Pillow's warning is silenced."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        return Image.open(BytesIO(content), formats=("PPM", "PNG"))


def _channels(image: Any) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The channels of an open image, 0 to 1, and which of its pixels are opaque."""
    if image.mode in ("I", "I;16", "I;16B"):
        grey = np.asarray(image, dtype=np.float32)[..., None] / np.float32(65535)
        return grey, np.ones(grey.shape[:2], dtype=bool)
    simple = image.mode in ("1", "L") and "transparency" not in image.info
    values = np.asarray(image.convert("L" if simple else "RGBA"), dtype=np.float32) / np.float32(255)
    if simple:
        return values[..., None], np.ones(values.shape, dtype=bool)
    return values[..., :3], values[..., 3] >= 1


def _too_large(path: Path, got: str) -> FieldError:
    """An image with too many cells."""
    return FieldError(
        f"{path.name}: expected at most {MAX_CELLS:,} cells, got {got}", "make it coarser, or cut out what you need"
    )
