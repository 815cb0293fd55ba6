"""Tables that are shown: in Markdown, and with colours on a page."""

import re
from dataclasses import dataclass, field


@dataclass(kw_only=True)
class Table:
    """Cells ready to be shown, the first of each row its title.

    Attributes:
        tones: Of cells that say what is better ('good') or worse ('bad'), by row and column.
        fold: After so many rows a page hides the others until they are asked for; None: never.
        title: What is hidden.
    """

    header: list[str]
    rows: list[list[str]] = field(default_factory=list)
    tones: dict[tuple[int, int], str] = field(default_factory=dict)
    fold: int | None = None
    title: str = "more rows"

    def markdown(self, most: int | None = None) -> str:
        """Its first rows; None: all."""
        lines = [self.header, ["---"] * len(self.header), *self.rows[:most]]
        return "\n".join(f"| {' | '.join(_escaped(line))} |" for line in lines)

    def tone(self, row: int, column: int) -> str:
        """'good', 'mixed' or 'bad', as the table says or for '2/2', '1/2' or '0/2'; or empty.

        What a paper reports and what is a goal is no result.
        """
        if (row, column) in self.tones:
            return self.tones[row, column]
        found = re.match(r"(\d+)/(\d+)\b", self.rows[row][column])
        if found is None or self.header[column] in ("paper", "goal"):
            return ""
        done, of = map(int, found.groups())
        return "good" if done == of else "mixed" if done else "bad"


def _escaped(cells: list[str]) -> list[str]:
    return [cell.replace("|", "\\|").replace("\n", " ") for cell in cells]
