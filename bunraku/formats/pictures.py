"""Pictures that files bring along: their size, read from the header before anything is decoded."""

import io
import warnings

from bunraku import limits


def count_pixels(content: bytes) -> int:
    """Give width times height of a picture; 0 if its header is not understood."""
    from PIL import Image  # takes .1 s, and only files with textures need it

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            width, height = Image.open(io.BytesIO(content)).size
    except Image.DecompressionBombError:
        return limits.PIXELS + 1  # more than twice Pillow's own limit, which is larger
    except (OSError, ValueError, SyntaxError, EOFError, OverflowError):
        return 0
    return width * height


def as_png_or_jpeg(content: bytes) -> bytes:
    """Give a picture in a format that glTF knows, re-encoded if need be.

    Raises:
        OSError, ValueError, SyntaxError or EOFError: if it cannot be decoded.
    """
    from PIL import Image

    picture = Image.open(io.BytesIO(content))
    if picture.format in ("PNG", "JPEG"):
        return content
    stream = io.BytesIO()
    picture.convert("RGBA").save(stream, "PNG")
    return stream.getvalue()
