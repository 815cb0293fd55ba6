"""What a codec encodes it decodes, exactly."""

import json
from dataclasses import dataclass, fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.diagrams.joints.joint_truth import UNKNOWN_JOINT, JointTruth
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.diagrams.run.sensor_streams.codecs import (
    CAMERA_POSE,
    JOINT_STATES,
    WRENCHES,
    Codec,
    Topic,
    codec_for,
)
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import SampleWindow, StampedImage
from crossmodal.systems.recordings.ros_messages import definition

NOW = 3_066_666_667  # [ns]
RNG = np.random.default_rng(0)


def over_the_wire(codec: Codec, value: Any, tmp_path: Any) -> list[tuple[int, Any]]:
    """The messages of a value, written into a file and read back."""
    from mcap.reader import make_reader

    path = tmp_path / "messages.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef(codec.message_type, definition(codec.message_type))
        for stamp, message in codec.encode(value, NOW):
            writer.write_message("/topic", schema, message, log_time=stamp)
        writer.finish()
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [
            (found.message.log_time, found.decoded_message)
            for found in reader.iter_decoded_messages()
        ]


def round_trip(value: Any, tmp_path: Any, topic: Topic | None = None) -> Any:
    codec = codec_for(value, topic)
    return codec.decode(over_the_wire(codec, value, tmp_path))


@pytest.mark.parametrize("kind", [ImageRgba8U, ImageDepth32F, ImageGrey8U])
def test_an_image_keeps_its_size_and_every_pixel(kind: Any, tmp_path: Any) -> None:
    image = kind(7, 5)
    image.mutable_data[:] = RNG.uniform(0, 250, image.mutable_data.shape)
    decoded = round_trip(image, tmp_path)
    assert type(decoded) is kind
    assert (decoded.width(), decoded.height()) == (7, 5)
    assert_array_equal(decoded.data, image.data)


def test_a_depth_image_keeps_what_is_not_a_number(tmp_path: Any) -> None:
    image = ImageDepth32F(3, 1)
    image.mutable_data[:, :, 0] = [[np.inf, np.nan, 0.0]]
    assert_array_equal(round_trip(image, tmp_path).data, image.data)


def test_a_stamped_image_keeps_its_stamp_and_one_without_has_that_of_the_log(tmp_path: Any) -> None:
    stamped = StampedImage(time=2.25, image=ImageDepth32F(3, 1, 1.5))
    decoded = round_trip(stamped, tmp_path)
    assert_allclose(decoded.time, 2.25, atol=1e-9)
    assert_array_equal(decoded.image.data, stamped.image.data)
    unstamped = StampedImage(time=0.0, image=ImageDepth32F(3, 1))
    assert_allclose(round_trip(unstamped, tmp_path).time, 1e-9 * NOW, atol=1e-12)


def test_the_pose_of_a_camera_survives_and_is_a_ros_pose_in_the_world(tmp_path: Any) -> None:
    xi = np.array([0.3, -1.2, 0.8, 0.1, -0.4, 2.0])
    root = RNG.normal(size=(6, 6))
    image = StampedImage(time=2.25, image=None, X_WC=se3.exp(xi), covariance=root @ root.T)
    messages = over_the_wire(CAMERA_POSE, image, tmp_path)
    X_WC, covariance = CAMERA_POSE.decode(messages)
    assert_allclose(X_WC, image.X_WC, atol=1e-14)
    assert_allclose(covariance, image.covariance, atol=1e-13)
    message = messages[0][1]
    assert message.header.frame_id == "world"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (2, 250_000_000)
    # ROS: the position first, both in the frame of the header.
    R, said = image.X_WC[:3, :3], np.reshape(message.pose.covariance, (6, 6))
    assert_allclose(said[:3, :3], R @ image.covariance[3:, 3:] @ R.T, atol=1e-13)
    assert_allclose(said[3:, 3:], R @ image.covariance[:3, :3] @ R.T, atol=1e-13)


def test_a_pose_that_nobody_knows_is_not_written() -> None:
    assert CAMERA_POSE.encode(StampedImage(time=0.0, image=None), NOW) == []


@pytest.mark.parametrize(
    ("size", "fields"), [(14, JOINT_STATES), (4, JOINT_STATES), (6, WRENCHES), (5, None)]
)
def test_a_window_keeps_its_samples_and_their_instants(
    size: int, fields: Any, tmp_path: Any
) -> None:
    window = SampleWindow(times=np.array([3.0, 3.005, 3.01]), values=RNG.normal(size=(3, size)))
    topic = None if fields is None else Topic(name="/samples", window=fields)
    assert codec_for(window, topic).is_window
    decoded = round_trip(window, tmp_path, topic)
    assert_allclose(decoded.times, window.times, atol=1e-9)
    assert_array_equal(decoded.values, window.values)


@pytest.mark.parametrize("fields", [JOINT_STATES, WRENCHES, None])
def test_a_window_without_samples_stays_as_wide_as_it_was(fields: Any, tmp_path: Any) -> None:
    window = SampleWindow(times=np.zeros(0), values=np.zeros((0, 6)))
    topic = None if fields is None else Topic(name="/samples", window=fields)
    decoded = round_trip(window, tmp_path, topic)
    assert decoded.times.shape == (0,)
    assert decoded.values.shape == (0, 6)


@pytest.mark.parametrize("size", [1, 2, 7])
def test_a_vector_keeps_all_digits(size: int, tmp_path: Any) -> None:
    value = RNG.normal(size=size) * 1e-7
    assert_array_equal(np.asarray(round_trip(value, tmp_path)), value)


def test_a_pose_is_the_same_but_for_rounding(tmp_path: Any) -> None:
    for _ in range(20):
        X = RigidTransform(RollPitchYaw(*RNG.uniform(-3, 3, 3)), RNG.normal(size=3))
        decoded = round_trip(X, tmp_path)
        assert_allclose(decoded.GetAsMatrix4(), X.GetAsMatrix4(), atol=1e-14)
        assert_array_equal(decoded.translation(), X.translation())


@dataclass(kw_only=True)
class Reading:
    """Numbers, texts, truth values and arrays, as an application may have them."""

    name: str
    count: int
    share: float
    valid: bool
    nothing: None
    vector: Array
    matrix: Array


def assert_same_fields(value: Any, expected: Any) -> None:
    assert type(value) is type(expected)
    for field in fields(expected):
        is_, was = getattr(value, field.name), getattr(expected, field.name)
        assert type(is_) is type(was), field.name
        assert_array_equal(is_, was)


def test_a_dataclass_keeps_every_field_with_its_type(tmp_path: Any) -> None:
    value = Reading(
        name='half "open", 3 °', count=2**60, share=0.1 + 0.2, valid=False, nothing=None,
        vector=RNG.normal(size=3) * 1e-9, matrix=np.array([[np.nan, 1.0], [np.inf, 1 / 3]]),
    )  # fmt: skip
    assert_same_fields(round_trip(value, tmp_path), value)


@pytest.mark.parametrize(
    "value",
    [
        TaskStatus(),
        TaskStatus(phase="stopped", done=True, note="grasp lost"),
        UNKNOWN_JOINT,
        JointTruth(name="slide", type="prismatic", axis_W=RNG.normal(size=3),
                   point_W=RNG.normal(size=3), parent_moves=True),
    ],
)  # fmt: skip
def test_the_values_of_our_own_stations_survive(value: Any, tmp_path: Any) -> None:
    assert_same_fields(round_trip(value, tmp_path), value)


def test_a_field_with_a_default_may_be_younger_than_the_recording_and_no_other() -> None:
    codec = codec_for(UNKNOWN_JOINT)
    ((stamp, content),) = codec.encode(replace(UNKNOWN_JOINT, name="slide", pitch=0.1), 0)

    def without(*names: str) -> list[tuple[int, Any]]:
        kept = json.loads(content["data"])
        data = json.dumps({key: item for key, item in kept.items() if key not in names})
        return [(stamp, SimpleNamespace(data=data))]

    assert codec.decode(without()).pitch == 0.1
    older = codec.decode(without("pitch"))
    assert older.name == "slide"
    assert np.isnan(older.pitch)
    with pytest.raises(TypeError, match="missing 1 required keyword-only argument: 'name'"):
        codec.decode(without("name"))


def test_the_last_of_several_messages_counts_but_for_windows() -> None:
    codec = codec_for(np.zeros(1))

    class Message:
        def __init__(self, data: float) -> None:
            self.data = data

    assert list(codec.decode([(0, Message(1.0)), (1, Message(2.0))])) == [2.0]
    assert not codec.is_window


@pytest.mark.parametrize("value", [{"a": 1}, "text", 3, None])
def test_a_type_that_no_message_holds_is_refused_by_its_name(value: Any) -> None:
    with pytest.raises(TypeError, match=f"the type {type(value).__name__} cannot be recorded"):
        codec_for(value)
