"""Images as stored: pixels in rows, ignoring orientation tags.

Pillow reads them. It scales PGM and PPM of any maximum value (1 to 65535) to white, like
GraphicsMagick in ROS's `map_server`, reads plain ones without a newline at their end, reports a
file that is cut short, and does not rotate a picture by its EXIF orientation: a camera's lens
distorts the sensor's rows.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from robotctl.errors import ConfigError

_FORMATS: Final = ("PNG", "JPEG", "PPM", "BMP", "WEBP", "TIFF", "GIF", "TGA", "JPEG2000", "AVIF")
"""Formats of Pillow that are read; some others start programs (Ghostscript)."""
_CUT_SHORT: Final = ("truncated", "Truncated", "EOF", "not enough", "requires a buffer of")
"""Errors by which Pillow and struct report that a file ends too soon."""
_ORIENTATION: Final = 0x0112
"""The tag of EXIF and TIFF (TIFF 6.0, section 8); 1 is upright, the others turn and mirror."""


def read_image(file: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Read an image.

    Returns
    -------
    NDArray
        (rows, columns) of 8 or 16 bits for a grey image; else (rows, columns, channels) of 8 bits:
        2 for grey and alpha, 3 for red, green and blue, 4 for these and alpha.

    Raises
    ------
    ConfigError
        If the file is not an image, damaged or cut short.
    OSError
        If it cannot be read.
    """
    with _opened(file) as image:
        if image.mode.startswith("I"):
            return np.asarray(image).astype(np.uint16)
        if image.mode == "F":
            raise ValueError("its pixels are floating point numbers; needed are 8 or 16 bits")
        colours = "L" if image.mode in {"1", "L", "LA"} else "RGB"
        alpha = "A" if image.has_transparency_data else ""
        return np.asarray(image.convert(colours + alpha))


def orientation(file: Path) -> int:
    """Return how a file asks to be turned, 1 (not at all) to 8 of EXIF; raises as `read_image`."""
    with _opened(file, as_tagged=True) as image:
        found = image.getexif().get(_ORIENTATION, 1)
    return found if found in range(1, 9) else 1


@contextmanager
def _opened(file: Path, *, as_tagged: bool = False) -> Iterator[Image.Image]:
    """Open an image; failures become plain errors."""
    data = file.read_bytes()
    size = " within its header"
    try:
        with warnings.catch_warnings():
            # Warnings of size (a map may be large, and is the user's own) and of odd metadata.
            warnings.simplefilter("ignore")
            with Image.open(BytesIO(data if as_tagged else _upright(data)), "r", _FORMATS) as image:
                size = f" within its {image.width} x {image.height} pixels"
                yield image
    except UnidentifiedImageError:
        kinds = ", ".join(_FORMATS[:6]).lower()
        raise ConfigError(
            f"{file}: no image that can be read, so not a picture or map; allowed are {kinds} of "
            "8 or 16 bits"
        ) from None
    except Image.DecompressionBombError as error:
        raise ConfigError(f"{file}: too large: {error}") from error
    except (OSError, SyntaxError, ValueError, struct.error) as error:
        if any(word in str(error) for word in _CUT_SHORT):
            raise ConfigError(f"{file}: cut short{size}") from error
        raise ConfigError(f"{file}: damaged: {error}") from error


def _upright(data: bytes) -> bytes:
    """Return a TIFF without its orientation tag, which Pillow would apply; other files unchanged.

    The tag is an entry of 12 bytes in the first directory: number, kind, count, value.
    """
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None:
        return data
    changed = bytearray(data)
    (first,) = struct.unpack_from(order + "I", data, 4)
    (entries,) = struct.unpack_from(order + "H", data, first)
    for at in range(first + 2, first + 2 + 12 * entries, 12):
        if struct.unpack_from(order + "H", data, at) == (_ORIENTATION,):
            struct.pack_into(order + "H", changed, at + 8, 1)
    return bytes(changed)
