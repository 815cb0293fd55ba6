"""What the words of a page's tables mean, and whether what a cell counts is good."""

import re
from collections.abc import Mapping, Sequence

from crossmodal.diagrams.evaluation.metric_table import Table
from crossmodal.diagrams.run.application import Application

_OF_ALL: Mapping[str, str] = {
    "done": "In how many of the episodes the task was done; what counts as done stands above.",
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


def words_of(application: Application, tables: Sequence[Table]) -> dict[str, str]:
    """What the words mean that stand in the titles of columns and rows.

    Those of the application come first, in its order.
    """
    titles = [text for table in tables for text in [*table.header, *(row[0] for row in table.rows)]]
    text = "\n".join(titles).lower()
    known = {**application.glossary, **_OF_ALL}
    return {word: meaning for word, meaning in known.items() if word.lower() in text}


def tone(table: Table, row: int, column: int) -> str:
    """'good', 'mixed' or 'bad', as the table says or for a count '2/2', '1/2' or '0/2'; or empty.

    What a paper reports and what is a goal is no result.
    """
    if (row, column) in table.tones:
        return table.tones[row, column]
    found = re.match(r"(\d+)/(\d+)\b", table.rows[row][column])
    if found is None or table.header[column] in ("paper", "goal"):
        return ""
    done, of = map(int, found.groups())
    return "good" if done == of else "mixed" if done else "bad"
