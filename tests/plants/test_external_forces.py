"""Forces from outside: where, when and in which axes they act."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia

from crossmodal.plants.external_forces import ExternalForce, ExternalForces

X_BF = RigidTransform(RollPitchYaw(0.0, 0.0, np.pi / 2.0), [0.1, 0.2, 0.3])


def make_plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.01)
    model = plant.AddModelInstance("chest")
    body = plant.AddRigidBody("drawer", model, SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
    plant.AddFrame(FixedOffsetFrame("handle", body.body_frame(), X_BF))
    plant.Finalize()
    return plant


def forces_at(time: float, *forces: ExternalForce) -> list[Any]:
    plant = make_plant()
    system = ExternalForces(plant, forces)
    context, plant_context = system.CreateDefaultContext(), plant.CreateDefaultContext()
    poses = plant.get_body_poses_output_port().Eval(plant_context)
    poses[1] = RigidTransform(RollPitchYaw(0.0, 0.0, np.pi / 2.0), [1.0, 0.0, 0.0])
    value = plant.get_body_poses_output_port().Allocate()
    value.set_value(poses)
    system.get_input_port().FixValue(context, value)
    context.SetTime(time)
    applied: list[Any] = system.get_output_port().Eval(context)
    return applied


def test_a_force_acts_at_its_frame_and_in_its_axes() -> None:
    push = ExternalForce(frame="chest::handle", force=np.array([-50.0, 0.0, 0.0]))
    (applied,) = forces_at(0.0, push)
    assert int(applied.body_index) == 1
    assert_allclose(applied.p_BoBq_B, X_BF.translation())
    assert_allclose(applied.F_Bq_W.translational(), [50.0, 0.0, 0.0], atol=1e-9)
    assert_allclose(applied.F_Bq_W.rotational(), np.zeros(3))


@pytest.mark.parametrize(("time", "count"), [(0.9, 0), (1.0, 1), (1.9, 2), (2.0, 1)])
def test_forces_act_from_their_start_to_before_their_end(time: float, count: int) -> None:
    early = ExternalForce(frame="chest::handle", start=1.0, end=2.0)
    late = ExternalForce(frame="chest::handle", start=1.5)
    assert len(forces_at(time, early, late)) == count


@pytest.mark.parametrize(
    ("force", "why"),
    [
        (ExternalForce(frame="desk::handle"), "no model named 'desk'"),
        (ExternalForce(frame="chest::knob"), "'chest' has no frame 'knob'"),
        (ExternalForce(frame="chest::handle", force=np.full(3, np.nan)), "force"),
    ],
)
def test_what_cannot_be_is_refused_by_name(force: ExternalForce, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        ExternalForces(make_plant(), [force])
