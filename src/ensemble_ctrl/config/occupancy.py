"""Occupancy grids as robots make them: ``map.yaml`` beside a PGM or PNG image, as ROS map servers read them."""

from __future__ import annotations

import math
import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.config.source import checked_path
from ensemble_ctrl.config.tree import TextError, Tree, start
from ensemble_ctrl.config.wrong import Wrong, is_number, show
from ensemble_ctrl.constraints.cells import Cells
from ensemble_ctrl.files import read_regular

MAX_CELLS = 16_000_000
LARGEST = 1e6
MAX_IMAGE_BYTES = 100_000_000
EXAMPLE = "for example  image: office.pgm, resolution: 0.05, origin: [-10, -10, 0]"


def read_occupancy(path: Path, text: str) -> Cells:
    """The grid that a map file and its image describe.

    Parameters
    ----------
    path : Path
        Of the map file; the image is in its folder or below.
    text : str
        What is in the map file.

    Raises
    ------
    TextError
        If a field is missing or wrong, or the image can't be read.

    Notes
    -----
    Only cells whose occupancy is below ``free_thresh`` are free: unknown cells, and those with any transparency, count
    as occupied, and of a coloured cell the channel that says most. Modes ``trinary`` and ``scale`` agree in this.
    """
    tree = Tree.read(text)
    fields = _Fields(tree, tree.data if isinstance(tree.data, dict) else {})
    size = fields.number("resolution", above=0.0)
    x, y, yaw = fields.numbers("origin", 3)
    free = fields.number("free_thresh", above=0.0, default=0.196)
    negate = fields.choice("negate", (0, 1, False, True), 0)
    fields.choice("mode", ("trinary", "scale"), "trinary")
    for key, values in (("resolution", [size]), ("origin", [x, y, yaw])):
        if max(map(abs, values)) > LARGEST:
            raise fields.wrong(key, f"expected at most {LARGEST:g}, got {max(values, key=abs):g}")
    name = fields.text("image")
    try:
        taken = _occupancy(checked_path(path.parent, name), bool(negate)) >= free
    except Wrong as error:
        raise fields.wrong("image", error.message, error.hint) from None
    return Cells(taken[::-1], size, (x, y), yaw)


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

    def numbers(self, key: str, count: int) -> list[float]:
        """A list of finite numbers."""
        value = self._data.get(key)
        if not isinstance(value, list) or len(value) != count or not all(map(is_number, value)):
            raise self.wrong(key, f"expected [x, y, yaw], got {show(value)}", "" if key in self._data else EXAMPLE)
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


def _occupancy(path: Path, negate: bool) -> NDArray[np.float32]:
    """How occupied each cell is, 0 to 1, shape (rows, columns), the top row first."""
    pixels, opaque = _pixels(path)
    light = pixels.max(axis=2) if negate else 1 - pixels.min(axis=2)
    return np.where(opaque, light, np.float32(1.0))


def _pixels(path: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The channels of an image, 0 to 1, shape (rows, columns, channels), and which of its pixels are opaque."""
    from PIL import Image, UnidentifiedImageError

    try:
        content = read_regular(path, MAX_IMAGE_BYTES)
        if len(content) > MAX_IMAGE_BYTES:
            raise Wrong(f"{path}: expected an image of at most {MAX_IMAGE_BYTES // 1_000_000} MB, got more")
        with _opened(content) as image:
            if image.width * image.height > MAX_CELLS:
                raise _too_large(path, f"{image.width} x {image.height}")
            return _channels(image)
    except FileNotFoundError:
        raise Wrong(f"{path}: no such file") from None
    except UnidentifiedImageError:
        raise Wrong(f"{path}: expected an image in PGM or PNG") from None
    except Image.DecompressionBombError:
        raise _too_large(path, "many more") from None
    except (OSError, ValueError, SyntaxError, EOFError, MemoryError) as error:
        raise Wrong(f"{path}: this image can't be read: {getattr(error, 'strerror', None) or error}") from None


def _opened(content: bytes) -> Any:
    """An image of which nothing but the head is read; how large it may be is ours to say, not Pillow's to warn of."""
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


def _too_large(path: Path, got: str) -> Wrong:
    """An image with too many cells."""
    return Wrong(
        f"{path}: expected at most {MAX_CELLS:,} cells, got {got}", "make it coarser, or cut out what you need"
    )
