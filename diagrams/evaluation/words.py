"""What the words of a page's tables mean."""

import re
from collections.abc import Mapping, Sequence

from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.run.application import Application

_OF_ALL: Mapping[str, str] = {
    "done": "Whether, or in how many of how many episodes, the task was done.",
    "paper": "What the paper that the system follows reports.",
    "goal": "What this project wants to reach.",
    "error": "The magnitude of estimate minus truth, which only the simulator knows.",
    "RMS": "The square root of the mean of the squares over time.",
    "reported deviation": (
        "The standard deviation that an estimator reports of its own error. If it is right, 95 of"
        " 100 errors are within two of them: fewer, and the estimator is too sure of itself; all of"
        " them, and it may be too cautious."
    ),
    "NEES": (
        "Normalised estimation error squared: the squared error in units of the reported"
        " covariance. If the covariance is right, it is inside its bounds at 95 % of the ticks."
        " Above them the error is larger than reported: the estimator is too sure of itself, and"
        " who relies on it may be misled. Below them the error is smaller than reported: it is too"
        " cautious, which only wastes information."
    ),
    "tick": "One update of all filters. Printed is what it took to compute.",
}


def words_of(
    application: Application, tables: Sequence[Table], lines: Sequence[str] = ()
) -> dict[str, str]:
    """What the words mean that stand in the titles of columns and rows, or in lines of text.

    Those of the application come first, in its order.
    """
    titles = [text for table in tables for text in [*table.header, *(row[0] for row in table.rows)]]
    text = "\n".join([*titles, *lines])
    known = {**application.glossary, **_OF_ALL}
    return {word: meaning for word, meaning in known.items() if _stands_in(word, text)}


def _stands_in(word: str, text: str) -> bool:
    """Whether a text has the word as it is, neither its plural nor its genitive."""
    return bool(re.search(rf"(?<!\w){re.escape(word)}(?!['\w])", text, re.IGNORECASE))


def columns_of(words: Mapping[str, str], tables: Sequence[Table]) -> dict[str, str]:
    """Those of the words that are titles of columns."""
    titles = {cell for table in tables for cell in table.header}
    return {word: meaning for word, meaning in words.items() if word in titles}
