"""What is true, as the station gives it and as an evaluation reads it from a record."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, Joint, ScrewJoint, SpatialInertia, UnitInertia
from synthetic_episode import GRASP_TIME, empty_episode, synthetic_episode, without_truth

from crossmodal.diagrams.joints.joint_truth import (
    ObjectTruth,
    add_tick,
    joint_constants,
    truth_of_ticks,
)
from crossmodal.diagrams.run.record import Tick
from crossmodal.models import SDF_DIR
from crossmodal.plants.parsing import make_parser
from crossmodal.systems.port_values import JointType

X_WO = RigidTransform([0.9, 0.1, 0.8])


def placed(model: str, joint: str, *, free: bool = False) -> tuple[MultibodyPlant, Joint]:
    plant = MultibodyPlant(0.0)
    (instance,) = make_parser(plant).AddModels(str(SDF_DIR / model))
    if not free:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("__model__", instance), X_WO)
    plant.Finalize()
    return plant, plant.GetJointByName(joint)


def test_the_constants_are_axis_and_place_of_the_joint_in_the_world() -> None:
    plant, joint = placed("cupboard_door.sdf", "hinge")
    constants = joint_constants(plant, joint)
    assert (constants.name, constants.type) == ("hinge", "revolute")
    assert_allclose(np.abs(constants.axis_W), [0, 0, 1], atol=1e-12)
    assert not constants.parent_moves
    # Points of the axis stay where they are when the door turns.
    context = plant.CreateDefaultContext()
    body = joint.child_body()
    p_BA = body.EvalPoseInWorld(context).inverse() @ constants.point_W
    joint.set_angle(context, 0.7)
    assert_allclose(body.EvalPoseInWorld(context) @ p_BA, constants.point_W, atol=1e-12)


def test_a_screw_has_the_axis_and_the_climb_per_radian_of_its_motion() -> None:
    plant = MultibodyPlant(0.0)
    body = plant.AddRigidBody("seat", SpatialInertia(1.0, np.zeros(3), UnitInertia(0.1, 0.1, 0.1)))
    X_WJ = RigidTransform(RollPitchYaw(0.3, -0.4, 0.5), [0.1, 0.2, 0.3])
    thread = plant.AddFrame(FixedOffsetFrame("thread", plant.world_frame(), X_WJ))
    rod = plant.AddFrame(FixedOffsetFrame("rod", body.body_frame(), RigidTransform([0.2, 0, 0])))
    joint = plant.AddJoint(ScrewJoint("screw", thread, rod, [0.6, 0.0, 0.8], 0.05, 0.0))
    plant.Finalize()
    constants = joint_constants(plant, joint)
    assert constants.type == "screw"
    context = plant.CreateDefaultContext()
    p_BA = body.EvalPoseInWorld(context).inverse() @ constants.point_W
    plant.SetPositions(context, [1.5])
    moved = body.EvalPoseInWorld(context) @ p_BA - constants.point_W
    assert_allclose(moved, 1.5 * constants.pitch * constants.axis_W, atol=1e-12)


def test_a_growing_position_moves_the_body_along_the_axis() -> None:
    plant, joint = placed("chest_drawer.sdf", "slide")
    axis = joint_constants(plant, joint).axis_W
    system = ObjectTruth(plant, joint)
    context = system.CreateDefaultContext()
    poses = []
    for q in (0.0, 0.1):
        system.get_input_port().FixValue(context, [q, 0.0])
        assert system.GetOutputPort("cheat_configuration").Eval(context) == [q]
        poses.append(np.array(system.GetOutputPort("cheat_body_pose").Eval(context).translation()))
        assert system.GetOutputPort("cheat_joint").Eval(context).name == "slide"
    assert_allclose(poses[1] - poses[0], 0.1 * axis, atol=1e-12)


def test_the_lid_of_a_free_box_has_a_parent_that_moves() -> None:
    assert joint_constants(*placed("cardboard_box.sdf", "hinge", free=True)).parent_moves
    assert not joint_constants(*placed("cardboard_box.sdf", "hinge")).parent_moves


def test_a_joint_of_another_type_is_refused() -> None:
    plant, joint = placed("chest_drawer.sdf", "slide")
    welds = [plant.get_joint(index) for index in plant.GetJointIndices()]
    (weld,) = (other for other in welds if other.name() != joint.name())
    with pytest.raises(ValueError, match="neither prismatic, revolute nor a screw"):
        joint_constants(plant, weld)


def test_the_truth_of_a_record_is_what_its_station_gave() -> None:
    record = synthetic_episode(JointType.REVOLUTE)
    truth = truth_of_ticks(record.station)
    assert (truth.name, truth.joint_type) == ("hinge", JointType.REVOLUTE)
    assert_allclose(truth.grasp_time, GRASP_TIME)
    assert truth.regrasp_times == []
    assert len(truth.times) == len(truth.configuration) == len(truth.X_WB) == len(record.station)
    assert truth.opening()[np.searchsorted(truth.times, GRASP_TIME)] == 0.0


def test_a_grasp_after_a_lost_one_is_told() -> None:
    record = synthetic_episode()
    for tick in record.station:
        if 5.0 <= tick.time < 7.0:
            tick.values = tick.values | {"interaction_active": np.zeros(1)}
    truth = truth_of_ticks(record.station)
    assert_allclose(truth.grasp_time, GRASP_TIME)
    assert_allclose(truth.regrasp_times, [7.0])
    assert_allclose(truth.last_grasp(6.9), GRASP_TIME)
    assert_allclose(truth.last_grasp(8.0), 7.0)


def test_without_the_truth_only_the_grasp_is_known() -> None:
    truth = truth_of_ticks(without_truth(synthetic_episode()).station)
    assert truth.joint_type is None
    assert len(truth.times) == len(truth.opening()) == 0
    assert truth.X_WB.shape == (0, 4, 4)
    assert_allclose(truth.grasp_time, GRASP_TIME)
    assert np.isnan(truth_of_ticks(empty_episode().station).grasp_time)


def test_what_is_true_now_follows_from_few_ticks() -> None:
    kept: list[Tick] = []
    ticks: list[Tick] = []
    grasped = [0] * 5 + [1] * 7 + [0] * 2 + [1] * 20 + [0] * 9
    for k, held in enumerate(grasped):
        values = {
            "cheat_configuration": np.array([0.01 * k**2]),
            "cheat_body_pose": RigidTransform([0.0, 0.0, 0.01 * k]),
            "interaction_active": np.array([float(held)]),
        }
        ticks.append(Tick(time=0.1 * k, values=values))
        add_tick(kept, ticks[-1])
        found, expected = truth_of_ticks(kept), truth_of_ticks(ticks)
        assert_allclose(found.grasp_time, expected.grasp_time)
        assert_allclose(found.regrasp_times, expected.regrasp_times)
        assert_allclose(found.opening()[[0, -1]], expected.opening()[[0, -1]])
        for time in (0.0, 0.25, *found.regrasp_times):  # Before the first grasp, too.
            openings = (np.interp(time, t.times, t.opening()) for t in (found, expected))
            assert_allclose(*openings)
    assert len(kept) <= 10


def test_what_is_kept_before_the_first_grasp_is_bounded_too() -> None:
    kept: list[Tick] = []
    for k in range(1000):
        values = {"interaction_active": np.zeros(1), "cheat_configuration": np.full(1, 0.1 * k)}
        add_tick(kept, Tick(time=0.1 * k, values=values))
    assert len(kept) <= 32
    assert [kept[0].time, kept[-1].time] == [0.0, pytest.approx(99.9)]
    times = [tick.time for tick in kept]
    assert times == sorted(times)


def test_a_position_alone_counts_from_when_it_is_known() -> None:
    ticks = [
        Tick(time=0.1 * k, values={"cheat_configuration": np.array([q])})
        for k, q in enumerate((np.nan, 0.02, 0.07))
    ]
    truth = truth_of_ticks(ticks)
    assert_allclose(truth.times, [0.1, 0.2])
    assert_allclose(truth.opening(), [0.0, 0.05])
    assert np.isnan(truth.X_WB).all()


def test_travel_counts_from_the_start_where_nobody_says_when_a_hand_held_the_object() -> None:
    ticks = [
        Tick(
            time=0.1 * k,
            values={"cheat_configuration": np.array([q]), "cheat_body_pose": RigidTransform()},
        )
        for k, q in enumerate((0.02, 0.02, 0.07))
    ]
    assert_allclose(truth_of_ticks(ticks).opening(), [0.0, 0.0, 0.05])
