"""Wavefront files (OBJ, MTL) as they are found in the wild, for a reader that takes plain ones."""

import re
from collections.abc import Callable

from crossmodal.plants.object_import.text import decoded

LIBRARY = "all.mtl"  # Name of the one that stands for all material libraries of a mesh.

_LIBRARY = re.compile(r"^[ \t]*mtllib[ \t](.*)$", re.MULTILINE)
# Options that may stand before the name of a picture, and how many values they have at most.
_OPTIONS = {
    **dict.fromkeys(("-blendu", "-blendv", "-boost", "-texres", "-clamp", "-bm", "-imfchan"), 1),
    **dict.fromkeys(("-type", "-cc"), 1),
    "-mm": 2,
    **dict.fromkeys(("-o", "-s", "-t"), 3),
}
_PLACES = {"-o": 0.0, "-s": 1.0, "-t": 0.0}  # Those that place the picture, with what changes none.


def plain_obj(
    content: bytes, read: Callable[[str], bytes], warn: Callable[[str], None]
) -> tuple[bytes, bytes]:
    """A mesh that names one library of materials, `LIBRARY`, and that library.

    Args:
        content: Of the OBJ file.
        read: Gives the content of a library that it names; raises a ValueError where there is none.
        warn: Takes a line for each thing that is left out.

    Returns:
        The contents of both, in UTF-8.
    """
    text = decoded(content)
    libraries = []
    for names in map(str.strip, _LIBRARY.findall(text)):
        found = _libraries(names, read)
        libraries += [decoded(each) for each in found]
        if not found:
            warn(f"mtllib '{names}': there is no such file that belongs to the model; left out")
    text = f"mtllib {LIBRARY}\n{_LIBRARY.sub('', text)}"
    lines = [_plain_line(line, warn) for each in libraries for line in each.splitlines()]
    return text.encode(), "\n".join(lines).encode()


def opacity(properties: dict[str, object]) -> float:
    """Of a material, from what its library says of it by lower-case key; one where nothing."""
    for key, is_transparency in (("d", False), ("tr", True)):
        words = properties.get(key)
        numbers = _numbers(words if isinstance(words, list) else [])
        if numbers:
            value = min(max(numbers[-1], 0.0), 1.0)
            return 1.0 - value if is_transparency else value
    return 1.0


def _libraries(names: str, read: Callable[[str], bytes]) -> list[bytes]:
    """The libraries of a line: one whose name may have blanks, or several."""
    words = names.split()
    for tried in ([names],) if len(words) == 1 else ([names], words):
        found = []
        for name in tried:
            try:
                found.append(read(name))
            except ValueError:
                continue
        if found:
            return found
    return []


def _plain_line(line: str, warn: Callable[[str], None]) -> str:
    """A line of a library; that of a picture with its name alone."""
    words = line.split()
    if not words or words.pop(0).lower() != "map_kd":
        return line.strip()
    while words and words[0].lower() in _OPTIONS:
        option, most = words[0].lower(), _OPTIONS[words[0].lower()]
        values = words[1 : most + 1]
        if option in (*_PLACES, "-mm"):  # Fewer numbers may be given.
            values = values[: len(_numbers(values))]
        if option in _PLACES and any(value != _PLACES[option] for value in _numbers(values)):
            warn(f"'{line.strip()}': {option} is left out")
        words = words[1 + len(values) :]
    return f"map_Kd {' '.join(words)}"


def _numbers(words: list[str]) -> list[float]:
    """The numbers with which words begin; those of `d -halo 0.5`, too."""
    numbers = []
    for word in words:
        try:
            numbers.append(float(word))
        except ValueError:
            if not numbers and word.startswith("-"):
                continue
            break
    return numbers
