"""The image of a map, as shades: what every program shows on a screen, whatever the format.

Pillow reads it. It scales PGM and PPM of any greatest value (1 to 65535) to that of its pixels, as
`map_server` has them from GraphicsMagick, reads plain ones without a newline at their end, and says
when a file is cut short.
"""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from robotctl.errors import ConfigError

_FORMATS: Final = ("PPM", "PNG", "BMP", "JPEG", "GIF", "TIFF", "WEBP", "TGA")
"""Of all that Pillow knows, those that hold pixels: others start programs, such as Ghostscript."""
_CUT_SHORT: Final = ("truncated", "Truncated", "EOF", "not enough")
"""How Pillow says that a file ends too soon."""


def read_map_image(file: Path) -> tuple[NDArray[np.integer], int, bool]:
    """Read an image.

    Returns
    -------
    tuple
        The pixels, (rows, columns) where they are grey and opaque, else (rows, columns, channels);
        the value of a white one; and whether the last channel is alpha.

    Raises
    ------
    ConfigError
        If the file is no image, damaged or cut short.
    OSError
        If it cannot be read.
    """
    data = BytesIO(file.read_bytes())
    size = ""
    try:
        # A map may be larger than what Pillow takes for an attack; it is the user's own file.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(data, formats=_FORMATS) as image:
                size = f" within its {image.width} x {image.height} pixels"
                return _pixels(image)
    except UnidentifiedImageError:
        pass
    except Image.DecompressionBombError as error:
        raise ConfigError(f"{file}: too large for a map: {error}") from error
    except (OSError, SyntaxError, ValueError) as error:
        if any(word in str(error) for word in _CUT_SHORT):
            raise ConfigError(f"{file}: cut short{size or ' within its header'}") from error
        raise ConfigError(f"{file}: damaged: {error}") from error
    raise ConfigError(f"{file}: no image with 8 or 16 bits that can be read: pgm, png, bmp")


def _pixels(image: Image.Image) -> tuple[NDArray[np.integer], int, bool]:
    """Return pixels, white and whether there is alpha, as `read_map_image`."""
    if image.mode.startswith("I"):  # 16 bits
        return np.asarray(image).astype(np.uint16), 65535, False
    if image.mode == "F":
        raise ValueError("pixels are floating point numbers; needed are 8 or 16 bits")
    grey = image.mode in {"1", "L", "LA"}
    if image.has_transparency_data:
        return np.asarray(image.convert("LA" if grey else "RGBA")), 255, True
    return np.asarray(image.convert("L" if grey else "RGB")), 255, False
