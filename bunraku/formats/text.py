"""Text of unknown encoding."""

UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


def decode_text(content: bytes) -> str:
    """Decode UTF-16 with its mark, UTF-8, or else Latin-1, in which any bytes mean something."""
    if content[:2] in UTF16_MARKS:
        return content.decode("utf-16", "replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")
