"""Text of files that do not say, or say wrongly, how it is encoded."""

import codecs

_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def decoded(content: bytes, said: str = "") -> str:
    """The text in a file: by its byte order mark, in UTF-8, as it says, or else in Latin-1.

    What is valid UTF-8 is hardly ever anything else, whatever it says.

    Args:
        content: Of the file.
        said: Name of the encoding that the file says it has; empty for none.
    """
    marked = [name for mark, name in _MARKS.items() if content.startswith(mark)]
    for name in [*marked, "utf-8", *filter(None, [said])]:
        try:
            return content.decode(name)
        except (UnicodeError, LookupError):
            continue
    return content.decode("latin-1")
