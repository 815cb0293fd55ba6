"""One joint from several tracks of the same object."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg

from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig, TypePriorsConfig
from crossmodal.systems.port_values import JointBelief, JointModelBelief, JointType
from crossmodal.systems.pose_tracks.joint_estimate import (
    JointEstimate,
    Progress,
    along_path,
    estimate_track,
    screw,
)
from crossmodal.systems.pose_tracks.pose_track import PoseTrack


def estimate_repeats(
    tracks: Sequence[PoseTrack],
    config: JointFiltersConfig | None = None,
    progress: Progress = iter,
) -> JointEstimate:
    """The joint that all tracks show, each with its own beginning.

    The types' probabilities multiply, those of the prior counted once. Axis and point are the
    means by their covariances; where the tracks disagree by more than these allow, the covariances
    grow by as much. The pitch is that of the track that knows it best. The zero of q, and B, are
    those of the first track.

    Args:
        tracks: Of the same body B in the same parent P, one or more.
        config: Of the joint filters.
        progress: Wraps the loop over the poses of each track.

    Raises:
        ValueError: for no track, and for one of less than two poses.
    """
    if not tracks:
        raise ValueError("no track; need one or more")
    each = [estimate_track(track, config, progress) for track in tracks]
    if len(each) == 1:
        return each[0]
    belief = joined_belief([one.belief for one in each], (config or JointFiltersConfig()))
    notes = [note for one in each for note in one.track.notes]
    types = {one.type for one in each}
    if len(types) > 1 or JointType.DISCONNECTED in types:
        alone = ", ".join(f"{one.type} (p = {one.probability:.3f})" for one in each)
        notes.append(
            f"alone the tracks show {alone}: are they repeats of one motion? Poses of what the body"
            " is joined to are those of its parent (--parent, X_AP)"
        )
    parts = [(one.track.times, one.track.X_AB, one.track.deviations) for one in each]
    times, X_AB, deviations = (np.concatenate(part) for part in zip(*parts, strict=True))
    track = PoseTrack(times=times, X_AB=X_AB, deviations=deviations, notes=tuple(notes))
    nothing = np.full(len(times), np.nan)
    first = next((one for one in each if one.type == belief.type), None)
    joined = JointEstimate(
        track=track,
        belief=belief,
        S_P=np.full(6, np.nan),
        X_PB_zero=np.full((4, 4), np.nan) if first is None else first.X_PB_zero,
        q=nothing,
        q_deviation=nothing,
        distance=np.full((len(times), 2), np.nan),
    )
    if first is None or belief.type == JointType.DISCONNECTED:
        return joined
    if not joined.moves:
        return along_path(joined)
    S_P = screw(belief)
    turns = slice(0, 3) if belief.type != JointType.PRISMATIC else slice(3, 6)
    return along_path(replace(joined, S_P=S_P * np.sign(S_P[turns] @ first.S_P[turns])))


def joined_belief(beliefs: Sequence[JointBelief], config: JointFiltersConfig) -> JointBelief:
    """The belief of all, each of which knows the prior."""
    prior = _prior(config.type_priors)
    log_p = {
        joint: sum(float(np.log(max(b.probabilities[joint], 1e-300))) for b in beliefs)
        - (len(beliefs) - 1) * float(np.log(prior[joint]))
        for joint in JointType
    }
    largest = max(log_p.values())
    weights = {joint: float(np.exp(value - largest)) for joint, value in log_p.items()}
    total = sum(weights.values())
    fits = [belief.fit for belief in beliefs if belief.fit is not None]
    return JointBelief(
        parent_id=beliefs[0].parent_id,
        child_id=beliefs[0].child_id,
        probabilities={joint: weight / total for joint, weight in weights.items()},
        models={joint: _joined([b.models[joint] for b in beliefs]) for joint in beliefs[0].models},
        updates=sum(belief.updates for belief in beliefs),
        skipped={
            reason: sum(belief.skipped.get(reason, 0) for belief in beliefs)
            for reason in {reason for belief in beliefs for reason in belief.skipped}
        },
        fit=max(fits, key=lambda fit: fit.reduced_chi_square / fit.bounds[1], default=None),
    )


def _prior(priors: TypePriorsConfig) -> dict[JointType, float]:
    return {joint: float(getattr(priors, joint.value)) for joint in JointType}


def _joined(models: Sequence[JointModelBelief]) -> JointModelBelief:
    """One type's parameters from all tracks; of a type that has none, the first one's."""
    first = models[0]
    if not all(np.isfinite(model.axis_P).all() for model in models):
        return first
    across = np.asarray(scipy.linalg.null_space(first.axis_P[None]))  # (3, 2), in P.
    axes = [across.T @ (m.axis_P * np.sign(m.axis_P @ first.axis_P)) for m in models]
    tilt, covariance = _mean(axes, [across.T @ m.axis_covariance @ across for m in models])
    axis = first.axis_P + across @ tilt
    axis = axis / np.linalg.norm(axis)
    across = np.asarray(scipy.linalg.null_space(axis[None]))
    turned = across.T @ scipy.linalg.null_space(first.axis_P[None])
    axis_covariance = across @ turned @ covariance @ turned.T @ across.T
    joined = replace(first, axis_P=axis, axis_covariance=axis_covariance)
    if np.isfinite(first.p_PA).all():
        points = [across.T @ (model.p_PA - first.p_PA) for model in models]
        offset, covariance = _mean(points, [across.T @ m.p_PA_covariance @ across for m in models])
        joined = replace(
            joined,
            p_PA=first.p_PA + across @ offset,
            p_PA_covariance=across @ covariance @ across.T,
        )
    surest = min(models, key=lambda model: model.pitch_variance)
    return replace(joined, pitch_mixture=surest.pitch_mixture)


def _mean(values: Sequence[Array], covariances: Sequence[Array]) -> tuple[Array, Array]:
    """The mean of vectors by their covariances, and its covariance.

    The covariance grows by chi-square per degree of freedom where that is above one.
    """
    informations = [np.linalg.inv(C) for C in covariances]
    covariance = np.linalg.inv(np.sum(informations, axis=0))
    weighted = [W @ value for W, value in zip(informations, values, strict=True)]
    mean = covariance @ np.sum(weighted, axis=0)
    errors = [value - mean for value in values]
    squared = sum(float(e @ W @ e) for e, W in zip(errors, informations, strict=True))
    degrees = len(mean) * (len(values) - 1)
    return mean, covariance * max(1.0, squared / degrees)
