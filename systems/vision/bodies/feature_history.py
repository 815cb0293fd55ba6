"""What the body tracker remembers of each feature."""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import STATIC_BODY, FeatureBelief

OUTLIER = -1  # Body number of features that were rejected by theirs.


@dataclass(kw_only=True)
class FeatureHistory(Immutable):
    """Recent positions of N features, newest last; never written after it is made.

    Attributes:
        ids: (N,), sorted.
        body: The body that each feature is assigned to (N,); `STATIC_BODY` for free ones,
            `OUTLIER` for those that are ignored for a while.
        p_W: Positions at the last H ticks (N, H, 3), [m].
        information: Of these (N, H, 3, 3), [1/m^2]; zero where the feature was not seen.
        rest_information: Sum over the samples that left the window (N, 3, 3), [1/m^2].
        rest_moment: Sum of information times position over the same (N, 3), [1/m].
        rest_until: Tick of the newest of these samples (N,); -1 without any.
        unseen: Ticks since last seen (N,).
        rejection_count: Ticks for which a free feature has disagreed with standing still, an
            assigned one with its body, or an outlier has been one (N,).
    """

    ids: Ids
    body: Ids
    p_W: Array
    information: Array
    rest_information: Array
    rest_moment: Array
    rest_until: Ids
    unseen: Ids
    rejection_count: Ids

    def select(self, index: Mask | Ids) -> "FeatureHistory":
        return FeatureHistory(**{name: value[index] for name, value in vars(self).items()})

    @property
    def seen(self) -> Mask:
        """Whether each feature was seen at the newest tick (N,)."""
        return np.asarray(self.unseen == 0)

    @property
    def samples(self) -> Mask:
        """At which ticks of the window each feature was seen (N, H)."""
        return np.asarray(self.information[:, :, 0, 0] > 0.0)


def no_history(window: int) -> FeatureHistory:
    return FeatureHistory(
        ids=np.zeros(0, np.int64),
        body=np.zeros(0, np.int64),
        p_W=np.zeros((0, window, 3)),
        information=np.zeros((0, window, 3, 3)),
        rest_information=np.zeros((0, 3, 3)),
        rest_moment=np.zeros((0, 3)),
        rest_until=np.zeros(0, np.int64),
        unseen=np.zeros(0, np.int64),
        rejection_count=np.zeros(0, np.int64),
    )


def remember(
    history: FeatureHistory,
    features: FeatureBelief,
    tick: int,
    *,
    floor: float,
    memory: int,
    rest_samples: float,
) -> FeatureHistory:
    """The history with one more tick.

    The oldest sample of a free feature that agrees with standing still moves on to its rest.

    Args:
        history: Up to the last tick.
        features: Seen at this tick.
        tick: Number of this tick.
        floor: Standard deviation added to the features' own, [m].
        memory: Ticks after which an unseen feature is forgotten.
        rest_samples: Effective number of samples that the rest holds at most.
    """
    window = history.p_W.shape[1]
    history = history.select(history.unseen < memory)
    leaving = (history.body == STATIC_BODY) & (history.rejection_count == 0) & history.samples[:, 0]
    oldest = history.information[:, 0] * leaving[:, None, None]
    keep = np.where(leaving, 1.0 - 1.0 / rest_samples, 1.0)
    rest_information = history.rest_information * keep[:, None, None] + oldest
    rest_moment = history.rest_moment * keep[:, None]
    rest_moment = rest_moment + np.einsum("nij,nj->ni", oldest, history.p_W[:, 0])
    shifted = replace(
        history,
        p_W=np.concatenate([history.p_W[:, 1:], history.p_W[:, -1:]], axis=1),
        information=np.concatenate(
            [history.information[:, 1:], np.zeros((len(history.ids), 1, 3, 3))], axis=1
        ),
        rest_information=rest_information,
        rest_moment=rest_moment,
        rest_until=np.where(leaving, tick - window, history.rest_until),
        unseen=history.unseen + 1,
    )
    new = ~np.isin(features.ids, shifted.ids)
    return _write_newest(_append(shifted, features.ids[new]), features, floor)


def _append(history: FeatureHistory, ids: Ids) -> FeatureHistory:
    count, window = len(ids), history.p_W.shape[1]
    blank = no_history(window)
    grown = {}
    for name, value in vars(history).items():
        shape = (count, *getattr(blank, name).shape[1:])
        grown[name] = np.concatenate([value, np.zeros(shape, value.dtype)])
    grown["ids"][len(history.ids) :] = ids
    grown["rest_until"][len(history.ids) :] = -1
    return FeatureHistory(**grown).select(np.argsort(grown["ids"], kind="stable"))


def _write_newest(history: FeatureHistory, features: FeatureBelief, floor: float) -> FeatureHistory:
    """Fills in the newest sample of a history that nobody else holds yet."""
    index = np.searchsorted(history.ids, features.ids)
    history.p_W[index, -1] = features.p_WF
    covariance = features.covariance + floor**2 * np.eye(3)
    history.information[index, -1] = np.linalg.inv(covariance)
    history.unseen[index] = 0
    return history


def forget(history: FeatureHistory, rows: Ids, ticks: int) -> FeatureHistory:
    """Frees some features and forgets all of them but their samples of the last `ticks`."""
    index = np.zeros(len(history.ids), bool)
    index[rows] = True
    information = history.information.copy()
    information[index, :-ticks] = 0.0
    return replace(
        history,
        body=np.where(index, STATIC_BODY, history.body),
        information=information,
        rest_information=np.where(index[:, None, None], 0.0, history.rest_information),
        rest_moment=np.where(index[:, None], 0.0, history.rest_moment),
        rest_until=np.where(index, -1, history.rest_until),
        rejection_count=np.where(index, 0, history.rejection_count),
    )
