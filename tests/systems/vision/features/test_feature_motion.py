"""Feature motion through its ports, on a textured wall that moves in front of the camera."""

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths import se3
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import FeatureBelief, StampedImage
from crossmodal.systems.vision.features.feature_motion import FeatureMotion
from crossmodal.systems.vision.features.feature_motion_config import (
    DetectionConfig,
    FeatureMotionConfig,
    FlowConfig,
    RegistrationConfig,
    TrackManagementConfig,
)
from crossmodal.systems.vision.features.feature_tracks import no_tracks

X_WC = np.eye(4)
Z = 1.0
RNG = np.random.default_rng(0)


def wall() -> np.ndarray:
    image = np.full((700, 900), 120.0, np.float32)
    for cells in (20, 50, 120, 250):
        noise = RNG.normal(0, 12, (cells, cells)).astype(np.float32)
        image += cv2.resize(noise, (900, 700), interpolation=cv2.INTER_CUBIC)
    return image


WALL = wall()


def frame(
    shift: tuple[float, float] = (0.0, 0.0),
    *,
    seed: int = 0,
    gain: float = 1.0,
    sigma: float = 1.5,
    robot: slice | None = None,
    z: float = Z,
) -> dict[str, Any]:
    """The wall's middle, moved by `shift` pixels."""
    rng = np.random.default_rng(seed)
    M = np.array([[1.0, 0, shift[0] - 130], [0, 1, shift[1] - 110]])
    grey = cv2.warpAffine(WALL, M, (640, 480), flags=cv2.INTER_CUBIC)
    grey = np.clip(np.round(gain * grey + rng.normal(0, sigma, grey.shape)), 0, 255)
    color, depth, mask = ImageRgba8U(640, 480), ImageDepth32F(640, 480), ImageGrey8U(640, 480)
    color.mutable_data[:, :, :3] = grey[:, :, None].astype(np.uint8)
    depth.mutable_data[:, :, 0] = z + rng.normal(0, 2e-3, grey.shape)
    mask.mutable_data[:] = 0
    if robot is not None:
        mask.mutable_data[:, robot] = 255
    return {
        "color_measured": StampedImage(time=0.0, image=color, X_WC=X_WC),
        "depth_measured": StampedImage(time=0.0, image=depth, X_WC=X_WC),
        "robot_mask": mask,
    }


@pytest.fixture
def follow(camera: Intrinsics, tick: Callable) -> Callable[..., list[FeatureBelief]]:
    def run(
        inputs: Callable[[int], dict], count: int, config: FeatureMotionConfig | None = None
    ) -> list[FeatureBelief]:
        system = FeatureMotion(config or FeatureMotionConfig(), camera)
        port = system.GetOutputPort("features_latest")
        return [port.Eval(context) for _, context in tick(system, inputs, count)]

    return run


def test_features_follow_the_wall_at_a_fraction_of_a_pixel(follow: Callable) -> None:
    steps = [(0.7 * k, -0.4 * k) for k in range(40)]
    beliefs = follow(lambda k: frame(steps[k], seed=k), 40)
    first, last = beliefs[0], beliefs[-1]
    assert len(first.ids) > 180
    _, a, b = np.intersect1d(first.ids, last.ids, return_indices=True)
    assert len(a) > 0.8 * len(first.ids)
    error = last.uv[b] - first.uv[a] - steps[-1]
    # OpenCV's warp, which makes the images, rounds to 1/32 px.
    assert np.abs(np.median(error, axis=0)).max() < 0.06
    assert np.median(np.linalg.norm(error, axis=1)) < 0.15
    assert np.all(last.age[b] == 39)


def test_positions_and_covariances_are_those_of_the_wall(follow: Callable) -> None:
    belief = follow(lambda k: frame(seed=k), 3)[-1]
    focal = 320.0 / np.tan(np.deg2rad(29.0))
    truth = np.column_stack([(belief.uv - [319.0, 239.0]) / focal * Z, np.full(len(belief.ids), Z)])
    error = belief.p_WF - truth
    assert np.abs(error).max() < 5e-3
    deviation = np.sqrt(belief.covariance[:, 2, 2])
    assert np.std(error[:, 2]) < 1.5 * np.median(deviation)
    assert np.linalg.eigvalsh(belief.covariance).min() > 0.0


def test_a_jump_of_25_pixels_is_bridged_by_the_pyramid(follow: Callable) -> None:
    beliefs = follow(lambda k: frame((0.0, 0.0) if k < 3 else (24.0, 9.0), seed=k), 5)
    _, a, b = np.intersect1d(beliefs[2].ids, beliefs[-1].ids, return_indices=True)
    moved = beliefs[-1].uv[b] - beliefs[2].uv[a]
    assert len(a) > 60
    assert np.abs(np.median(moved - [24.0, 9.0], axis=0)).max() < 0.1


def test_a_prediction_bridges_what_nothing_else_can(camera: Intrinsics, tick: Callable) -> None:
    system = FeatureMotion(FeatureMotionConfig(flow=FlowConfig(max_features=0)), camera)
    port = system.GetOutputPort("features_latest")
    jump = np.array([60.0, -35.0])
    known: dict[str, FeatureBelief] = {}

    def inputs(k: int) -> dict:
        values = frame(seed=k) if k < 2 else frame(tuple(jump), seed=k)
        if k == 2:
            before = known["before"]
            focal = 320.0 / np.tan(np.deg2rad(29.0))
            p_WF = before.p_WF + np.append((jump + 1.0) / focal * Z, 0.0)
            values["features_predicted"] = replace(before, p_WF=p_WF)
        return values

    for k, context in tick(system, inputs, 3):
        if k == 1:
            known["before"] = port.Eval(context)
    after = port.Eval(context)
    _, a, b = np.intersect1d(known["before"].ids, after.ids, return_indices=True)
    assert len(a) > 120
    moved = after.uv[b] - known["before"].uv[a]
    assert np.abs(np.median(moved - jump, axis=0)).max() < 0.1


def test_the_robot_kills_what_it_covers_and_ids_are_never_used_again(follow: Callable) -> None:
    def inputs(k: int) -> dict:
        return frame(seed=k, robot=slice(200, 300) if 5 <= k < 10 else None)

    beliefs = follow(inputs, 15)
    under = (beliefs[4].uv[:, 0] > 200) & (beliefs[4].uv[:, 0] < 299)
    covered = set(beliefs[4].ids[under].tolist())
    assert len(covered) > 15
    border = FeatureMotionConfig().tracks.robot_border
    for belief in beliefs[5:10]:
        assert not np.any((belief.uv[:, 0] > 200 - border) & (belief.uv[:, 0] < 299 + border))
    for belief in beliefs[5:]:
        assert not covered & set(belief.ids.tolist())
    new = set(beliefs[-1].ids.tolist()) - set(beliefs[4].ids.tolist())
    assert new
    assert min(new) > max(beliefs[4].ids)


def test_a_drifting_exposure_does_not_matter(follow: Callable) -> None:
    gains = np.linspace(1.0, 0.4, 20)
    beliefs = follow(lambda k: frame(seed=k, gain=float(gains[k])), 20)
    kept = np.isin(beliefs[0].ids, beliefs[-1].ids)
    assert np.mean(kept) > 0.95


def test_in_the_dark_nothing_is_seen_and_nothing_is_born(follow: Callable) -> None:
    beliefs = follow(lambda k: frame(seed=k, gain=1.0 if k < 5 else 0.0, sigma=4.0), 60)
    assert len(beliefs[4].ids) > 150
    assert all(len(belief.ids) == 0 for belief in beliefs[5:])


def test_after_a_short_blackout_the_same_features_are_found(follow: Callable) -> None:
    dark = range(5, 20)
    beliefs = follow(lambda k: frame(seed=k, gain=0.0 if k in dark else 1.0), 23)
    kept = np.isin(beliefs[4].ids, beliefs[-1].ids)
    assert np.mean(kept) > 0.95


def test_what_the_noise_drowns_is_left_alone(follow: Callable) -> None:
    """A dark half of the wall, which is noisier than the bright one."""

    def inputs(k: int) -> dict:
        values = frame(seed=k, sigma=0.5)
        grey = values["color_measured"].image.mutable_data[:, :320, :3]
        noise = np.random.default_rng(k).normal(0, 6.0, grey.shape[:2])
        faint = 20.0 + 0.2 * (grey[:, :, 0] - 120.0) + noise
        grey[:] = np.clip(np.round(faint), 0, 255).astype(np.uint8)[:, :, None]
        return values

    beliefs = follow(inputs, 12)
    assert max(int(np.sum(belief.uv[:, 0] < 310)) for belief in beliefs) == 0
    assert np.sum(beliefs[-1].uv[:, 0] > 330) > 60


def test_a_feature_without_depth_is_not_seen(follow: Callable) -> None:
    def inputs(k: int) -> dict:
        values = frame(seed=k)
        if k >= 2:
            values["depth_measured"].image.mutable_data[:, :320] = 0.0
            values["depth_measured"].image.mutable_data[:, 320:400] = np.nan
        return values

    beliefs = follow(inputs, 4)
    assert np.any(beliefs[1].uv[:, 0] < 300)
    assert np.all(beliefs[-1].uv[:, 0] > 400)


def test_features_are_where_the_depth_image_says_that_the_camera_was(follow: Callable) -> None:
    """The wall stands still, and the camera moves 0.2 m away from it and turns nowhere."""

    def inputs(k: int) -> dict:
        back = X_WC.copy()
        back[2, 3] = -0.05 * k
        values = frame(seed=k, z=Z + 0.05 * k)
        values["depth_measured"] = replace(values["depth_measured"], X_WC=back)
        return values

    beliefs = follow(inputs, 5)
    for belief in beliefs[1:]:
        assert len(belief.ids) > 60
        assert_allclose(belief.p_WF[:, 2], Z, atol=0.01)


def test_a_turned_camera_turns_what_it_sees(follow: Callable) -> None:
    turned = se3.exp(np.array([0.2, -0.4, 0.9, 0.3, 0.1, -0.2]))

    def inputs(k: int) -> dict:
        values = frame(seed=k)
        values["depth_measured"] = replace(values["depth_measured"], X_WC=turned)
        return values

    straight, seen = follow(lambda k: frame(seed=k), 2)[-1], follow(inputs, 2)[-1]
    assert_allclose(seen.p_WF, straight.p_WF @ turned[:3, :3].T + turned[:3, 3], atol=1e-12)


def test_an_image_that_does_not_say_where_its_camera_is_is_refused(follow: Callable) -> None:
    def inputs(k: int) -> dict:
        values = frame(seed=k)
        return values | {
            "depth_measured": StampedImage(time=0.0, image=values["depth_measured"].image)
        }

    with pytest.raises(ValueError, match="does not say where its camera is"):
        follow(inputs, 1)


def test_latest_needs_no_input_and_estimated_reacts_at_once(camera: Intrinsics) -> None:
    system = FeatureMotion(FeatureMotionConfig(), camera)
    latest = system.GetOutputPort("features_latest")
    estimated = system.GetOutputPort("features_estimated")
    for i in range(system.num_input_ports()):
        assert not system.HasDirectFeedthrough(i, latest.get_index())
    context = system.CreateDefaultContext()
    for name, value in frame().items():
        system.GetInputPort(name).FixValue(context, value)
    assert len(estimated.Eval(context).ids) > 150
    assert len(latest.Eval(context).ids) == 0


def test_a_deep_copy_of_the_state_shares_its_images() -> None:
    tracks = no_tracks(FeatureMotionConfig())
    assert copy.deepcopy(tracks) is tracks


@pytest.mark.parametrize(
    ("config", "named"),
    [
        (
            FeatureMotionConfig(detection=DetectionConfig(interval=0.03)),
            "FeatureMotion: detection.interval = 0.03 s, need >= a tick, 0.0667 s",
        ),
        (
            FeatureMotionConfig(tracks=TrackManagementConfig(max_features=0)),
            "FeatureMotion: tracks.max_features = 0",
        ),
        (
            FeatureMotionConfig(registration=RegistrationConfig(min_correlation=1.5)),
            "FeatureMotion: registration.min_correlation = 1.5",
        ),
    ],
)
def test_impossible_values_are_refused_by_name(
    camera: Intrinsics, config: FeatureMotionConfig, named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        FeatureMotion(config, camera)
