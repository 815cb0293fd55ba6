"""Rigid-body motion through its ports, on synthetic features with known motion and noise."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from crossmodal.maths import se3
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import (
    HELD_BODY,
    NO_POSE,
    BodyMotion,
    BodyPrediction,
    BodyPredictions,
    FeatureBelief,
    PoseBelief,
)
from crossmodal.systems.shared_settings import with_shared
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision.bodies.rigid_body_motion import RigidBodyMotion
from crossmodal.systems.vision.bodies.rigid_body_motion_config import (
    AssociationConfig,
    BodyInitiationConfig,
    FeatureHistoryConfig,
    LandmarkConfig,
    RigidBodyMotionConfig,
)

X_WC = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0.7], [0, 0, 0, 1]])
ONSET = 40  # Tick at which the body starts to move.
# White noise, as simulated here, leaves nothing for the floors to cover.
WHITE = RigidBodyMotionConfig(
    history=FeatureHistoryConfig(floor=0.0),
    landmarks=LandmarkConfig(floor=0.0, walk=0.0, turn_walk=0.0),
)


def path(kind: str, k: int) -> np.ndarray:
    """Displacement X_W(k) X_W(0)^-1 of the body."""
    seconds = max(k - ONSET, 0) / 15.0
    way = seconds**2 if seconds < 0.5 else seconds - 0.25
    if kind == "drawer":
        return se3.exp(np.array([0, 0, 0, -0.02 * way, 0.004 * way, 0]))
    if kind == "door":
        hinge = np.eye(4)
        hinge[:3, 3] = [1.0, 0.25, 0.5]
        return hinge @ se3.exp(np.array([0, 0, 0.1 * way, 0, 0, 0])) @ se3.inverse(hinge)
    return np.eye(4)


@dataclass(kw_only=True)
class Stream:
    """Features of a static world and of one body, some of which are replaced now and then."""

    kind: str
    seed: int
    on_body: int = 40
    still: int = 100
    ticks: int = 140
    lit_from: int = 0
    dark_from: int = 10**6

    def __post_init__(self) -> None:
        rng = np.random.default_rng([self.seed, 11])
        count = self.on_body + self.still
        self.moves = np.arange(count) < self.on_body
        near = rng.uniform([0.95, -0.2, 0.4], [1.0, 0.2, 0.7], (count, 3))
        far = rng.uniform([0.9, -0.6, 0.0], [1.8, 0.6, 1.2], (count, 3))
        p_0 = np.where(self.moves[:, None], near, far)
        ids = np.arange(count)
        self.beliefs: list[FeatureBelief] = []
        self.moving_ids: set[int] = set(range(self.on_body))
        for k in range(self.ticks):
            dying = np.nonzero(rng.random(count) < 0.005)[0]
            p_0[dying] += rng.uniform(-0.02, 0.02, (len(dying), 3))
            ids[dying] = ids.max() + 1 + np.arange(len(dying))
            self.moving_ids |= set(ids[self.moves].tolist())
            self.beliefs.append(self._measure(rng, k, p_0, ids))

    def _measure(
        self, rng: np.random.Generator, k: int, p_0: np.ndarray, ids: np.ndarray
    ) -> FeatureBelief:
        X = path(self.kind, k)
        p_W = np.where(self.moves[:, None], p_0 @ X[:3, :3].T + X[:3, 3], p_0)
        ray = p_W - X_WC[:3, 3]
        z = np.linalg.norm(ray, axis=1)
        ray /= z[:, None]
        sigma = 0.5 * (1.2e-3 + 1.9e-3 * (z - 0.4) ** 2)
        covariance = sigma[:, None, None] ** 2 * ray[:, :, None] * ray[:, None, :]
        covariance = covariance + (1e-4) ** 2 * np.eye(3)
        L = np.linalg.cholesky(covariance)
        p_W = p_W + np.einsum("nij,nj->ni", L, rng.normal(size=p_W.shape))
        lit = self.lit_from <= k < self.dark_from
        seen = (rng.random(len(ids)) > 0.03) & lit
        order = rng.permutation(np.nonzero(seen)[0])
        return FeatureBelief(
            ids=ids[order],
            uv=np.zeros((len(order), 2)),
            p_WF=p_W[order],
            covariance=covariance[order],
            age=np.zeros(len(order), np.int64),
        )

    def error(self, body: BodyMotion, k: int, start: int = 0) -> np.ndarray:
        """Error (6,) of the body's displacement since tick `start`, in B."""
        X_WB = path(self.kind, k) @ se3.inverse(path(self.kind, start)) @ body.X_WB_reference
        return se3.log(se3.inverse(body.motion.X) @ X_WB)


def nees(body: BodyMotion, error: np.ndarray) -> float:
    return float(error @ np.linalg.solve(body.motion.covariance[:6, :6], error))


@pytest.fixture
def play(camera: Intrinsics, tick: Callable) -> Callable:
    """Runs a stream and gives the body motions of each tick."""

    def run(
        stream: Stream,
        config: RigidBodyMotionConfig | None = None,
        priors: list[PoseBelief] | None = None,
        joints: Callable[[int], BodyPredictions] | None = None,
    ) -> list[list[BodyMotion]]:
        system = RigidBodyMotion(
            config or RigidBodyMotionConfig(), camera, X_WC, priors is not None
        )

        def inputs(k: int) -> dict:
            values = {"features_estimated": stream.beliefs[k]}
            if priors is not None:
                values["held_body_prior"] = priors[k]
            if joints is not None:
                values["joint_predictions"] = joints(k)
            return values

        port = system.GetOutputPort("body_motions_latest")
        return [port.Eval(context).bodies for _, context in tick(system, inputs, stream.ticks)]

    return run


@pytest.mark.parametrize("kind", ["drawer", "door"])
def test_displacement_is_as_wrong_as_its_covariance_says(play: Callable, kind: str) -> None:
    values, means = [], []
    for seed in range(5):
        stream = Stream(kind=kind, seed=seed, ticks=110)
        motions = play(stream, WHITE)
        run = [nees(m[0], stream.error(m[0], k)) for k, m in enumerate(motions) if m]
        values += run
        means.append(np.mean(run))
    # Errors of one run are correlated in time, so that runs, not ticks, are the sample.
    assert 3.5 < np.mean(means) < 9.0
    assert np.mean(np.array(values) < chi2.ppf(0.975, 6)) > 0.9


def test_default_floors_make_it_no_less_sure_than_three_times(play: Callable) -> None:
    stream = Stream(kind="drawer", seed=1)
    honest, default = play(stream, WHITE)[-1][0], play(stream)[-1][0]
    ratio = np.diag(default.motion.covariance)[:6] / np.diag(honest.motion.covariance)[:6]
    assert np.all(ratio > 0.9)
    assert np.sqrt(ratio[3:]).max() < 5.0


@pytest.mark.parametrize("seed", range(3))
def test_a_drawer_at_2_cm_per_second_is_found_within_a_second(play: Callable, seed: int) -> None:
    stream = Stream(kind="drawer", seed=seed, ticks=60)
    motions = play(stream)
    born = next(k for k, m in enumerate(motions) if m)
    assert ONSET < born < ONSET + 15
    body = motions[born][0]
    assert body.body_id == 2
    assert np.all(body.X_WB_reference[:3, :3] == np.eye(3))
    assert np.linalg.norm(stream.error(body, born)[3:]) < 2e-3


def test_a_static_world_holds_no_body(play: Callable) -> None:
    for seed in range(3):
        assert not any(play(Stream(kind="still", seed=seed, ticks=200)))


def test_features_that_stray_in_all_directions_make_no_body(play: Callable) -> None:
    stream = Stream(kind="still", seed=4, ticks=90)
    rng = np.random.default_rng(0)
    drift = rng.normal(scale=0.3e-3, size=(40, 3))
    for k, belief in enumerate(stream.beliefs):
        p_WF = belief.p_WF.copy()
        strays = belief.ids < 40
        p_WF[strays] += drift[belief.ids[strays]] * max(k - ONSET, 0)
        stream.beliefs[k] = replace(belief, p_WF=p_WF)
    assert not any(play(stream))


def test_patches_on_a_seam_that_move_half_the_way_make_no_third_body(play: Callable) -> None:
    stream = Stream(kind="drawer", seed=4)
    for k, belief in enumerate(stream.beliefs):
        p_WF = belief.p_WF.copy()
        p_WF[belief.ids < 8] -= 0.5 * path("drawer", k)[:3, 3]
        stream.beliefs[k] = replace(belief, p_WF=p_WF)
    motions = play(stream)
    assert all([b.body_id for b in m] in ([], [2]) for m in motions)
    last = motions[-1][0]
    assert not set(range(8)) & set(last.feature_ids.tolist())
    assert np.linalg.norm(stream.error(last, stream.ticks - 1)[3:]) < 1e-3


def test_features_belong_to_the_body_that_carries_them(play: Callable) -> None:
    stream = Stream(kind="drawer", seed=2)
    motions = play(stream)
    assert all(len(m) <= 1 for m in motions)
    assigned = motions[-1][0].feature_ids
    assert len(assigned) >= 30
    assert set(assigned.tolist()) <= stream.moving_ids
    # Those born on the moving body too.
    assert np.sum(assigned >= stream.on_body + stream.still) >= 3


def test_a_feature_that_changes_sides_is_released(play: Callable) -> None:
    stream = Stream(kind="drawer", seed=3)
    for k in range(80, stream.ticks):
        belief = stream.beliefs[k]
        p_WF = belief.p_WF.copy()
        stopped = np.isin(belief.ids, [0, 1, 2])
        p_WF[stopped] -= path("drawer", k)[:3, 3] - path("drawer", 80)[:3, 3]
        stream.beliefs[k] = replace(belief, p_WF=p_WF)
    motions = play(stream)
    assert {0, 1, 2} & set(motions[79][0].feature_ids.tolist())
    assert not {0, 1, 2} & set(motions[-1][0].feature_ids.tolist())
    assert nees(motions[-1][0], stream.error(motions[-1][0], stream.ticks - 1)) < 22.5


def test_without_features_a_body_coasts_with_growing_doubt_and_is_then_given_up(
    play: Callable,
) -> None:
    dark = 80
    stream = Stream(kind="drawer", seed=0, ticks=dark + 40, dark_from=dark)
    motions = play(stream)
    alive = [k for k, m in enumerate(motions) if m]
    config = RigidBodyMotionConfig()
    assert alive[-1] == dark + whole_ticks(config.patience, config.period) - 1
    assert [motions[k][0].is_seen for k in alive] == [k < dark for k in alive]
    deviations = [np.sqrt(np.trace(motions[k][0].motion.covariance[:6, :6])) for k in alive]
    assert np.all(np.diff(deviations[alive.index(dark) - 1 :]) > 0)
    last = motions[alive[-1]][0]
    assert last.X_WB_reference[0, 3] - last.motion.X[0, 3] > 0.04  # Went on at about 2 cm/s.
    assert nees(last, stream.error(last, alive[-1])) < 22.5


def test_every_covariance_is_symmetric_and_positive_definite(play: Callable) -> None:
    for motions in play(Stream(kind="door", seed=1)):
        for body in motions:
            for matrix in (body.motion.covariance, body.p_BF_covariance):
                np.testing.assert_allclose(matrix, matrix.T, atol=1e-18)
                assert np.linalg.eigvalsh(matrix).min() > 0.0


def test_a_joint_prediction_that_fits_better_is_taken(play: Callable, camera: Intrinsics) -> None:
    """A body that jumps by 4 cm between two ticks, which only its joint foresaw."""
    stream = Stream(kind="drawer", seed=5, ticks=75)
    jump = np.array([0.0, 0.0, 0.0, -0.04, 0.0, 0.0])
    for k in range(70, stream.ticks):
        belief = stream.beliefs[k]
        moves = np.isin(belief.ids, list(stream.moving_ids))
        stream.beliefs[k] = replace(belief, p_WF=belief.p_WF + np.outer(moves, jump[3:]))
    blind = play(stream)
    X_next = blind[69][0].motion.X.copy()
    X_next[:3, 3] += jump[3:] + path("drawer", 70)[:3, 3] - path("drawer", 69)[:3, 3]

    def joints(k: int) -> BodyPredictions:
        pose = PoseBelief(X=X_next, covariance=1e-6 * np.eye(6))
        prediction = BodyPrediction(body_id=2, source="prismatic", pose=pose)
        return BodyPredictions(predictions=[prediction] if k == 70 else [])

    seen = play(stream, joints=joints)[70][0]
    truth = path("drawer", 70) @ seen.X_WB_reference
    truth[:3, 3] += jump[3:]
    assert np.linalg.norm(seen.motion.X[:3, 3] - truth[:3, 3]) < 1e-3


def prior_path(stream: Stream, held_at: int, slip: float, lead: int) -> list[PoseBelief]:
    """Priors of a hand at X_WH that moves `lead` ticks early and by `slip` too far."""
    X_WH = np.eye(4)
    X_WH[:3, 3] = [0.93, 0.0, 0.55]
    priors = []
    for k in range(stream.ticks):
        if k < held_at:
            priors.append(NO_POSE)
            continue
        way = path(stream.kind, k + lead)[:3, 3] * (1.0 + slip)
        X = X_WH.copy()
        X[:3, 3] += way
        sigma = np.repeat([2e-3 + 0.1 * np.linalg.norm(way), 1e-3 + 0.1 * np.linalg.norm(way)], 3)
        priors.append(PoseBelief(X=X, covariance=np.diag(sigma**2)))
    return priors


@pytest.mark.parametrize("slip", [0.0, 0.1])
def test_what_moves_with_the_hand_joins_the_held_body_at_once(play: Callable, slip: float) -> None:
    held_at = 30
    stream = Stream(kind="drawer", seed=6)
    priors = prior_path(stream, held_at, slip, lead=0)
    motions = play(stream, WHITE, priors)
    assert not motions[held_at - 1]
    assert [b.body_id for b in motions[held_at]] == [HELD_BODY]
    np.testing.assert_allclose(motions[held_at][0].X_WB_reference, priors[held_at].X)
    joined = next(k for k, m in enumerate(motions) if m and len(m[0].feature_ids) >= 6)
    assert ONSET < joined < ONSET + 12
    assert all([b.body_id for b in m] == [HELD_BODY] for m in motions[held_at:])
    last = motions[-1][0]
    assert set(last.feature_ids.tolist()) <= stream.moving_ids
    assert np.linalg.norm(stream.error(last, stream.ticks - 1, held_at)[3:]) < 1.5e-3
    assert nees(last, stream.error(last, stream.ticks - 1, held_at)) < 22.5


def test_a_hand_that_moves_alone_takes_no_feature_along(play: Callable) -> None:
    stream = Stream(kind="still", seed=7, ticks=100)
    moving = Stream(kind="drawer", seed=7, ticks=100)
    motions = play(stream, None, prior_path(moving, 30, 0.0, lead=0))
    assert all(len(m[0].feature_ids) == 0 for m in motions[30:])
    assert np.linalg.norm(motions[-1][0].motion.X[:3, 3] - [0.93, 0.0, 0.55]) > 0.05


def test_in_the_dark_the_held_body_follows_the_hand(play: Callable) -> None:
    dark = 90
    stream = Stream(kind="drawer", seed=8, dark_from=dark, ticks=dark + 45)
    priors = prior_path(stream, 30, 0.05, lead=0)
    motions = play(stream, None, priors)
    assert len(motions[-1]) == 1
    np.testing.assert_allclose(motions[-1][0].motion.X, priors[-1].X, atol=1e-12)


def test_features_that_come_late_show_the_motion_since_they_came(play: Callable) -> None:
    lit = 100
    stream = Stream(kind="drawer", seed=10, lit_from=lit, ticks=lit + 120)
    motions = play(stream, None, prior_path(stream, 30, 0.2, lead=0))
    found = next(k for k, m in enumerate(motions) if m and m[0].reset_count)
    first, last = motions[found][0], motions[-1][0]
    assert lit < found < lit + 45
    assert last.reset_count == 1
    assert len(first.feature_ids) >= RigidBodyMotionConfig().landmarks.reset_support
    assert set(last.feature_ids.tolist()) <= stream.moving_ids
    assert np.linalg.norm(stream.error(first, found, 30)[3:]) > 0.01
    moved = path("drawer", stream.ticks - 1) @ se3.inverse(path("drawer", found))
    error = se3.log(se3.inverse(last.motion.X) @ moved @ first.motion.X)
    assert np.linalg.norm(error[3:]) < 3e-3


def test_features_that_come_late_stay_if_the_hand_turned_on_the_handle(play: Callable) -> None:
    lit = 100
    stream = Stream(kind="door", seed=10, lit_from=lit, ticks=lit + 60)
    X_WH = np.eye(4)
    X_WH[:3, 3] = [0.93, 0.0, 0.55]
    sigma = np.repeat([0.3, 5e-3], 3)
    priors = [NO_POSE] * 30
    for k in range(30, stream.ticks):
        X = path("door", k) @ X_WH
        X[:3, :3] = se3.so3_exp(np.array([0.0, 0.02 * (k - 30), 0.0]))  # Only the hand turns so.
        priors.append(PoseBelief(X=X, covariance=np.diag(sigma**2)))
    motions = play(stream, None, priors)
    found = next(k for k, m in enumerate(motions) if m and m[0].reset_count)
    assert motions[-1][0].reset_count == 1
    assert min(len(m[0].feature_ids) for m in motions[found:]) >= 8
    moved = path("door", stream.ticks - 1) @ se3.inverse(path("door", found))
    last = motions[-1][0]
    error = se3.log(se3.inverse(last.motion.X) @ moved @ motions[found][0].motion.X)
    assert np.linalg.norm(error[:3]) < 0.02


def test_the_held_body_ends_with_the_grasp(play: Callable) -> None:
    stream = Stream(kind="drawer", seed=9, ticks=90)
    priors = prior_path(stream, 30, 0.0, lead=0)
    priors[80:] = [NO_POSE] * 10
    motions = play(stream, None, priors)
    assert motions[79][0].body_id == HELD_BODY
    assert all(b.body_id != HELD_BODY for b in motions[80])


def test_the_same_stream_gives_the_same_bodies(play: Callable) -> None:
    stream = Stream(kind="drawer", seed=1, ticks=80)
    first, second = play(stream)[-1][0], play(stream)[-1][0]
    np.testing.assert_array_equal(first.motion.X, second.motion.X)
    np.testing.assert_array_equal(first.motion.covariance, second.motion.covariance)


def test_predictions_and_latest_need_no_input(camera: Intrinsics) -> None:
    system = RigidBodyMotion(RigidBodyMotionConfig(), camera, X_WC, True)
    for port in ("body_motions_latest", "features_predicted"):
        index = system.GetOutputPort(port).get_index()
        for i in range(system.num_input_ports()):
            assert not system.HasDirectFeedthrough(i, index)
    estimated = system.GetOutputPort("body_motions_estimated").get_index()
    assert all(system.HasDirectFeedthrough(i, estimated) for i in range(3))


def test_features_are_predicted_where_their_body_takes_them(
    camera: Intrinsics, tick: Callable
) -> None:
    stream = Stream(kind="drawer", seed=1, ticks=100)
    system = RigidBodyMotion(RigidBodyMotionConfig(), camera, X_WC)
    port = system.GetOutputPort("features_predicted")
    for _, context in tick(system, lambda k: {"features_estimated": stream.beliefs[k]}, 99):
        predicted = port.Eval(context)
    _, mine, theirs = np.intersect1d(predicted.ids, stream.beliefs[99].ids, return_indices=True)
    error = predicted.p_WF[mine] - stream.beliefs[99].p_WF[theirs]
    moving = np.isin(predicted.ids[mine], list(stream.moving_ids))
    for group in (moving, ~moving):
        assert np.sum(group) > 30
        assert np.abs(np.mean(error[group], axis=0)).max() < 6e-4


@pytest.mark.parametrize(
    ("config", "named"),
    [
        (
            RigidBodyMotionConfig(history=FeatureHistoryConfig(window=0.7)),
            "RigidBodyMotion: history.window = 0.7 s, need >= 11 ticks, 0.733 s",
        ),
        (
            with_shared(RigidBodyMotionConfig(), period=0.2),
            "RigidBodyMotion: history.newest = 0.2 s, need >= 2 ticks, 0.4 s",
        ),
        (
            RigidBodyMotionConfig(association=AssociationConfig(rejection_time=0.01)),
            "RigidBodyMotion: association.rejection_time = 0.01 s, need >= a tick, 0.0667 s",
        ),
        (
            RigidBodyMotionConfig(initiation=BodyInitiationConfig(min_gain=-1.0)),
            "RigidBodyMotion: initiation.min_gain = -1.0",
        ),
    ],
)
def test_impossible_values_are_refused_by_name(
    camera: Intrinsics, config: RigidBodyMotionConfig, named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        RigidBodyMotion(config, camera, X_WC)
