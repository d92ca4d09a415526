"""Fetch what the URIs of a document name: data inside them, or files beside the document."""

import base64
import binascii
from urllib.parse import unquote

from bunraku.errors import Code
from bunraku.formats.files import read_beside
from bunraku.types import FormatError


def read_uri(path: str, where: str, uri: str) -> tuple[bytes, str]:
    """Fetch the content of a URI, and its media type if the URI says it.

    Raises:
        FormatError: naming `where`, if the URI is not allowed or cannot be read.
    """
    if not uri.startswith("data:"):
        return read_beside(path, uri, where=where), ""
    header, comma, body = uri.partition(",")
    if not comma or not header.endswith(";base64"):
        raise FormatError(
            path, where, "data URI must be base64 (data:TYPE;base64,...)", code=Code.URI_DATA
        )
    try:
        content = base64.b64decode(unquote(body), validate=True)
    except (binascii.Error, ValueError):
        raise FormatError(
            path, where, "data URI is not valid base64; export again", code=Code.URI_DATA
        ) from None
    return content, header[len("data:") :].split(";")[0]
