from typing import Any

import numpy as np
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageRgba8U
from synthetic_episode import PERIOD, ReplayedBeliefs, connect_all, synthetic_episode

from crossmodal.diagrams.crossmodal.episode_parts import QUANTITIES
from crossmodal.diagrams.joints.joint_truth import TRUTH_QUANTITIES
from crossmodal.diagrams.run.record import Quantity, TaskStatus
from crossmodal.diagrams.run.recorder import EpisodeRecorder, TickStopwatch
from crossmodal.systems.port_values import StampedImage


class FakeCamera(LeafSystem):
    """Images whose pixels hold the time in tenths of a second; counts how often they are read."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = 0
        self.DeclareAbstractOutputPort(
            "color_measured",
            lambda: AbstractValue.Make(StampedImage(time=0.0, image=ImageRgba8U(8, 6))),
            self._calc,
            {self.time_ticket()},
        )

    def _calc(self, context: Context, output: Value) -> None:
        self.reads += 1
        image = ImageRgba8U(8, 6)
        image.mutable_data[:] = round(10 * context.get_time())
        output.set_value(StampedImage(time=context.get_time(), image=image))


def record(duration: float, **config: Any) -> tuple[EpisodeRecorder, FakeCamera]:
    builder = DiagramBuilder()
    source = builder.AddSystem(ReplayedBeliefs(synthetic_episode()))
    camera = builder.AddSystem(FakeCamera())
    recorder = builder.AddSystem(
        EpisodeRecorder(
            PERIOD,
            ["vision", "proprioception", "crossmodal"],
            QUANTITIES,
            TRUTH_QUANTITIES,
            ["color_measured"],
            **config,
        )
    )
    connect_all(builder, source, recorder)
    connect_all(builder, camera, recorder)
    Simulator(builder.Build()).AdvanceTo(duration)
    return recorder, camera


def test_what_a_value_says_is_not_worth_keeping_is_not_kept() -> None:
    recorder, _ = record(6.0)
    bodies = recorder.estimators["vision"].ticks[-1].values["body_motions_latest"].bodies
    given = synthetic_episode().estimators["vision"].ticks[89].values["body_motions_latest"].bodies
    assert given[0].p_BF_covariance.size > 0
    assert bodies[0].p_BF_covariance.size == 0
    assert_allclose(bodies[0].motion.X, given[0].motion.X)
    assert_allclose(bodies[0].p_BF, given[0].p_BF)


def test_belief_and_truth_of_one_tick_are_stored_under_its_time() -> None:
    expected = synthetic_episode()
    recorder, _ = record(6.0 + 0.6 * PERIOD)
    assert len(recorder.station) == 91
    for k, (tick, given) in enumerate(zip(recorder.station, expected.station, strict=False)):
        assert_allclose(tick.time, k * PERIOD)
        assert set(tick.values) == set(given.values)
        assert tick.values["cheat_joint"].name == given.values["cheat_joint"].name
        for port in ("cheat_configuration", "interaction_active"):
            assert_allclose(tick.values[port], given.values[port])
        pose, true_pose = (one.values["cheat_body_pose"] for one in (tick, given))
        assert_allclose(pose.GetAsMatrix4(), true_pose.GetAsMatrix4())
    for name, estimator in recorder.estimators.items():
        assert len(estimator.ticks) == 91
        replayed = expected.estimators[name].ticks
        for tick, given in zip(estimator.ticks, replayed, strict=False):
            assert_allclose(tick.time, given.time)
            assert set(tick.values) == set(given.values)
            joints, others = (one.values["joints_latest"].joints for one in (tick, given))
            for joint, other in zip(joints, others, strict=True):
                assert_allclose(joint.model.configuration, other.model.configuration)


def test_images_are_kept_with_their_time_and_their_number_is_bounded() -> None:
    recorder, camera = record(15.0, picture_interval=0.2, max_pictures=10)
    pictures = recorder.pictures
    times = np.array([picture.time for picture in pictures])
    assert 5 <= len(pictures) <= 10
    assert pictures[0].time == 0.0
    assert times[-1] > 12.0
    assert np.max(np.diff(times)) < 2.5 * np.min(np.diff(times))
    for picture in pictures:
        assert picture.port == "color_measured"
        assert picture.color.shape == (6, 8, 3)
        assert picture.color[0, 0, 0] == round(10 * picture.time)
    assert camera.reads < 60


def test_images_of_several_cameras_are_in_order_of_time() -> None:
    builder = DiagramBuilder()
    ports = ["left", "right"]
    recorder = builder.AddSystem(EpisodeRecorder(PERIOD, [], [], pictures=ports))
    for port in ports:
        camera = builder.AddSystem(FakeCamera())
        builder.Connect(camera.get_output_port(), recorder.GetInputPort(port))
    Simulator(builder.Build()).AdvanceTo(1.9)
    kept = [(picture.time, picture.port) for picture in recorder.pictures]
    assert [time for time, _ in kept] == sorted(time for time, _ in kept)
    assert [port for _, port in kept].count("left") == [port for _, port in kept].count("right") > 2


def test_what_has_no_source_is_left_out() -> None:
    builder = DiagramBuilder()
    source = builder.AddSystem(ReplayedBeliefs(synthetic_episode()))
    recorder = builder.AddSystem(
        EpisodeRecorder(PERIOD, ["vision"], QUANTITIES, TRUTH_QUANTITIES, ["color_measured"])
    )
    for name in ("interaction_active", "cheat_configuration"):
        builder.Connect(source.GetOutputPort(name), recorder.GetInputPort(name))
    Simulator(builder.Build()).AdvanceTo(0.5)
    assert set(recorder.station[-1].values) == {"interaction_active", "cheat_configuration"}
    assert recorder.estimators["vision"].ticks[-1].values == {}
    assert recorder.pictures == []


class Counter(LeafSystem):
    """A vector, a Drake value and a value of our own, all written in place again and again."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareVectorOutputPort("vector", 2, lambda c, o: o.SetFromVector([c.get_time()] * 2))
        self.DeclareAbstractOutputPort(
            "pose",
            lambda: Value(RigidTransform()),
            lambda c, o: o.get_mutable_value().set_translation([c.get_time(), 0.0, 0.0]),
        )


def test_what_was_recorded_does_not_change_with_the_port() -> None:
    builder = DiagramBuilder()
    source = builder.AddSystem(Counter())
    quantities = [
        Quantity(port="vector", model=np.zeros(2)),
        Quantity(port="pose", model=RigidTransform()),
    ]
    recorder = builder.AddSystem(EpisodeRecorder(PERIOD, [], [], quantities))
    connect_all(builder, source, recorder)
    Simulator(builder.Build()).AdvanceTo(1.0)
    times = [tick.time for tick in recorder.station]
    assert_allclose([tick.values["vector"][0] for tick in recorder.station], times)
    poses = [tick.values["pose"].translation()[0] for tick in recorder.station]
    assert_allclose(poses, times)


def test_a_phase_is_an_event_when_it_begins_if_it_has_a_name() -> None:
    recorder = EpisodeRecorder(PERIOD, [], [])
    for time, status in enumerate(
        [
            TaskStatus(),
            TaskStatus(phase="closing"),
            TaskStatus(phase="closing"),
            TaskStatus(),
            TaskStatus(phase="closing"),
            TaskStatus(phase="stopped", done=True, note="grasp lost"),
            TaskStatus(phase="stopped", done=True, note="grasp lost"),
        ]
    ):
        recorder.note_status(float(time), status)
    events = [(event.time, event.name) for event in recorder.events]
    assert events == [(1.0, "closing"), (4.0, "closing"), (5.0, "grasp lost")]


class Order(LeafSystem):
    def __init__(self, name: str, order: list[str]) -> None:
        super().__init__()
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, lambda c, s: order.append(name))


def test_stopwatches_enclose_what_was_added_between_them() -> None:
    builder = DiagramBuilder()
    order: list[str] = []
    camera = builder.AddSystem(FakeCamera())
    start = builder.AddSystem(TickStopwatch(PERIOD, [camera.get_output_port().Allocate()]))
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
