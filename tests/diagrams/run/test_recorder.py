import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageRgba8U
from synthetic_episode import GRASP_TIME, PERIOD, ReplayedBeliefs, connect_all, synthetic_episode

from diagrams.run.recorder import EpisodeRecorder, RecorderConfig, TickStopwatch
from systems.port_values import JointType


class FakeCamera(LeafSystem):
    """Images whose pixels hold the time in tenths of a second; counts how often they are read."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = 0
        self.DeclareAbstractOutputPort(
            "color_image", lambda: Value(ImageRgba8U(8, 6)), self._calc, {self.time_ticket()}
        )

    def _calc(self, context: Context, output: Value) -> None:
        self.reads += 1
        image = ImageRgba8U(8, 6)
        image.mutable_data[:] = round(10 * context.get_time())
        output.set_value(image)


def record(duration: float, **config: float) -> tuple[EpisodeRecorder, FakeCamera]:
    result = synthetic_episode()
    builder = DiagramBuilder()
    source = builder.AddSystem(ReplayedBeliefs(result))
    camera = builder.AddSystem(FakeCamera())
    recorder = builder.AddSystem(
        EpisodeRecorder(RecorderConfig(**config), ["vision", "proprioception", "crossmodal"])
    )
    connect_all(builder, source, recorder)
    connect_all(builder, camera, recorder)
    Simulator(builder.Build()).AdvanceTo(duration)
    return recorder, camera


def test_belief_and_truth_of_one_tick_are_stored_under_its_time() -> None:
    expected = synthetic_episode()
    recorder, _ = record(6.0 + 0.6 * PERIOD)
    truth = recorder.truth("slide", JointType.PRISMATIC, np.array([1.0, 0, 0]), np.zeros(3))
    count = len(truth.times)
    assert count == 91
    assert_allclose(truth.times, np.arange(count) * PERIOD)
    assert_allclose(truth.configuration, expected.truth.configuration[:count])
    assert_allclose(truth.X_WB, expected.truth.X_WB[:count])
    assert_allclose(truth.grasp_time, GRASP_TIME)
    for name, modality in recorder.modalities.items():
        assert len(modality.ticks) == count
        for tick, replayed in zip(modality.ticks, expected.modalities[name].ticks, strict=False):
            assert_allclose(tick.time, replayed.time)
            assert len(tick.joints.joints) == len(replayed.joints.joints)
            for joint, other in zip(tick.joints.joints, replayed.joints.joints, strict=True):
                assert_allclose(joint.model.configuration, other.model.configuration)


def test_images_are_kept_with_the_features_of_their_tick_and_their_number_is_bounded() -> None:
    recorder, camera = record(15.0, frame_interval=0.2, max_frames=10)
    frames = recorder.frames
    times = np.array([frame.time for frame in frames])
    assert 5 <= len(frames) <= 10
    assert frames[0].time == 0.0
    assert times[-1] > 12.0
    assert np.max(np.diff(times)) < 2.5 * np.min(np.diff(times))
    for frame in frames:
        assert frame.color.shape == (6, 8, 3)
        assert frame.color[0, 0, 0] == round(10 * frame.time)
        assert set(frame.features) == {"vision", "proprioception", "crossmodal"}
    assert camera.reads < 60


def test_unconnected_beliefs_are_empty() -> None:
    builder = DiagramBuilder()
    source = builder.AddSystem(ReplayedBeliefs(synthetic_episode()))
    recorder = builder.AddSystem(EpisodeRecorder(RecorderConfig(), ["vision"]))
    for name in ("interaction_active", "cheat_configuration", "cheat_body_pose"):
        builder.Connect(source.GetOutputPort(name), recorder.GetInputPort(name))
    Simulator(builder.Build()).AdvanceTo(0.5)
    tick = recorder.modalities["vision"].ticks[-1]
    assert tick.joints.joints == []
    assert tick.grasp is None
    assert tick.feature_count == 0
    assert recorder.frames == []


def test_impossible_values_are_refused() -> None:
    with pytest.raises(ValueError, match=r"EpisodeRecorder: need period > 0 s, got nan"):
        EpisodeRecorder(RecorderConfig(period=float("nan")), [])
    with pytest.raises(ValueError, match="max_frames >= 3"):
        EpisodeRecorder(RecorderConfig(max_frames=2), [])
    with pytest.raises(ValueError, match="TickStopwatch: need period > 0 s"):
        TickStopwatch(0.0)


class Order(LeafSystem):
    def __init__(self, name: str, order: list[str]) -> None:
        super().__init__()
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, lambda c, s: order.append(name))


def test_stopwatches_enclose_what_was_added_between_them() -> None:
    builder = DiagramBuilder()
    order: list[str] = []
    camera = builder.AddSystem(FakeCamera())
    start = builder.AddSystem(TickStopwatch(PERIOD, [Value(ImageRgba8U())]))
    start.marks = _Logged(order, "start")  # type: ignore[assignment]
    builder.AddSystem(Order("filter", order))
    stop = builder.AddSystem(TickStopwatch(PERIOD))
    stop.marks = _Logged(order, "stop")  # type: ignore[assignment]
    builder.Connect(camera.get_output_port(), start.get_input_port())
    Simulator(builder.Build()).AdvanceTo(2.5 * PERIOD)
    assert order == ["start", "filter", "stop"] * 3
    assert len(start.marks) == len(stop.marks) == 3
    assert all(a <= b for a, b in zip(start.marks, stop.marks, strict=True))
    assert camera.reads == 3


class _Logged(list):
    """A list that also logs that something was appended."""

    def __init__(self, log: list[str], name: str) -> None:
        super().__init__()
        self._log, self._name = log, name

    def append(self, item: object) -> None:
        super().append(item)
        self._log.append(self._name)
