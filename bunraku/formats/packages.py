"""USD packages: a zip file in which nothing is compressed, and every file begins at 64 bytes.

Reference:
    Pixar 2018, "Usdz File Format Specification".
"""

import io
import zipfile
from collections.abc import Mapping

ALIGNMENT = 64  # bytes
HEADER, EXTRA_HEADER = 30, 4  # bytes of a file's header in a zip, and of one extra field in it
PADDING = 0x1986  # the kind of extra field that holds nothing


def pack(files: Mapping[str, bytes]) -> bytes:
    """Pack files, the one that is opened first; the same files give the same bytes."""
    package = io.BytesIO()
    with zipfile.ZipFile(package, "w", zipfile.ZIP_STORED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)  # of 1980, whatever the clock says
            begins = package.tell() + HEADER + len(name.encode()) + EXTRA_HEADER
            padding = -begins % ALIGNMENT
            kind, size = PADDING.to_bytes(2, "little"), padding.to_bytes(2, "little")
            entry.extra = kind + size + bytes(padding)
            archive.writestr(entry, content)
    return package.getvalue()
