"""An episode's record with its joint compared to the truth."""

from dataclasses import dataclass

from crossmodal.diagrams.joints.joint_metrics import JointSeries, joint_series
from crossmodal.diagrams.joints.joint_truth import Truth, truth_of_ticks
from crossmodal.diagrams.run.record import EpisodeRecord


@dataclass(frozen=True, kw_only=True)
class JointEpisode:
    """A record, the truth in it and every estimator's beliefs against that, evaluated once.

    Attributes:
        record: Of the episode.
        truth: For the evaluation alone.
        series: By estimator, of those that ticked.
    """

    record: EpisodeRecord
    truth: Truth
    series: dict[str, JointSeries]


def joint_episode(record: EpisodeRecord) -> JointEpisode:
    truth = truth_of_ticks(record.station)
    return JointEpisode(
        record=record,
        truth=truth,
        series={
            name: joint_series(estimator.ticks, truth)
            for name, estimator in record.estimators.items()
        },
    )
