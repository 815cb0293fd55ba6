"""Experiments: scenarios to be repeated over seeds, and the figures by which they are compared."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from crossmodal.maths.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A figure of an episode, computed once from its summary.

    Attributes:
        name: In the tidy table, and by which an experiment refers to it.
        value: Of the whole summary or, `by_estimator`, of one estimator's part of it: a number in
            SI and rad, true or false, or None where there is none. A KeyError says that an episode
            has nothing of the kind.
        unit: In SI; a function of the same mapping where it depends on the episode.
        by_estimator: Whether each estimator has one.
        title: Of its row in the tables; empty for one that only the tidy table holds.
        cell: From one value per episode, NaN for those that have none, and their unit to the text
            of a cell.
        better: 'less' or 'more', where that is better; empty where neither is.
        totals: Whether the table over all experiments counts in how many of all episodes it is
            true.
    """

    name: str
    value: Callable[[Mapping[str, Any]], Any]
    unit: str | Callable[[Mapping[str, Any]], str] = ""
    by_estimator: bool = True
    title: str = ""
    cell: Callable[[Array, str], str] | None = None
    better: Literal["", "less", "more"] = ""
    totals: bool = False

    def unit_in(self, record: Mapping[str, Any]) -> str:
        """The unit in an episode, from what `value` is computed of."""
        return self.unit if isinstance(self.unit, str) else self.unit(record)


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What a metric of an experiment is compared with.

    Attributes:
        paper: What the paper reports.
        goal: What this project wants to reach.
    """

    paper: str = ""
    goal: str = ""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A scenario to be repeated over seeds.

    Attributes:
        scenario: Its name.
        description: One line.
        references: By the name of a metric.
        without: Names of metrics that mean nothing in this experiment.
        notes: What a reader of the tables has to know: what is simpler than in the paper,
            tolerances, where it ends; a sentence each.
    """

    scenario: str
    description: str
    references: Mapping[str, Reference] = field(default_factory=dict)
    without: Sequence[str] = ()
    notes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column of the table over all experiments: a metric, of one estimator or the episode."""

    header: str
    metric: str
    estimator: str = ""


@dataclass(frozen=True, kw_only=True)
class CampaignPlot:
    """A picture of many episodes.

    Attributes:
        caption: What it shows.
        draw: From an `evaluation.campaign.Campaign` that has ended episodes.
    """

    caption: str
    draw: "Callable[[Any], Figure | None]"
