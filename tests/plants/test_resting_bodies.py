"""Bodies that rest are locked, and move as free ones do when something comes near."""

from dataclasses import dataclass

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from crossmodal.maths.arrays import Array
from crossmodal.plants.parsing import make_parser
from crossmodal.plants.resting_bodies import RestingBodies

EDGE = 0.06
PLACES = {  # Of the middles. `upper` lies on `lower`, `beside` touches it.
    "lower": [0.0, 0.0, 0.5 * EDGE],
    "upper": [0.0, 0.0, 1.5 * EDGE],
    "beside": [EDGE, 0.0, 0.5 * EDGE],
    "next": [2.0 * EDGE + 0.02, 0.0, 0.5 * EDGE],
    "far": [0.0, 0.4, 0.5 * EDGE],
    "last": [0.0, -0.4, 0.5 * EDGE],
}
# A finger goes to the boxes, pushes them, stays there, and leaves.
STARTS, MEETS, STOPS, LEAVES, SPEED = 0.5, 1.5, 2.0, 3.0, 0.1
BEHIND = -0.5 * EDGE - SPEED * (MEETS - STARTS)  # Where its tip is at first.
END = 4.5


def _box(edges: list[float], contact: str) -> str:
    size = f"<geometry><box><size>{' '.join(map(str, edges))}</size></box></geometry>"
    friction = "<drake:mu_static>0.5</drake:mu_static><drake:mu_dynamic>0.5</drake:mu_dynamic>"
    properties = f"<drake:proximity_properties>{contact}{friction}</drake:proximity_properties>"
    return f"<collision name='box'>{size}{properties}</collision>"


def _scene() -> str:
    soft = (
        "<drake:compliant_hydroelastic/>"
        "<drake:hydroelastic_modulus>1e7</drake:hydroelastic_modulus>"
    )
    moment = 0.2 * EDGE**2 / 6.0
    inertia = "".join(f"<i{a}{a}>{moment}</i{a}{a}>" for a in "xyz")
    inertial = f"<inertial><mass>0.2</mass><inertia>{inertia}</inertia></inertial>"
    boxes = "".join(
        f"<link name='{name}'><pose>{x} {y} {z} 0 0 0</pose>{inertial}{_box([EDGE] * 3, soft)}"
        "</link>"
        for name, (x, y, z) in PLACES.items()
    )
    table = _box([1.5, 1.5, 0.04], "<drake:rigid_hydroelastic/>")
    finger = _box([0.02, 0.02, 0.02], soft)
    return f"""<sdf version="1.9" xmlns:drake="drake.mit.edu"><model name="scene">
      <link name="table"><pose>0 0 -0.02 0 0 0</pose>{table}</link>
      <joint name="weld" type="fixed"><parent>world</parent><child>table</child></joint>
      <link name="finger"><pose>{BEHIND - 0.01} 0 0.02 0 0 0</pose>{inertial}{finger}</link>
      <joint name="slide" type="prismatic"><parent>world</parent><child>finger</child>
        <axis><xyz>1 0 0</xyz><limit><effort>100</effort></limit></axis>
        <drake:controller_gains p="20000" d="300"/></joint>
      {boxes}</model></sdf>"""


@dataclass
class Ran:
    """Where the boxes were (N, K, 3), and which were locked (N, K), at the times (N,)."""

    times: Array
    places: Array
    locked: Array

    def place(self, name: str) -> Array:
        return self.places[:, list(PLACES).index(name)]

    def free(self, name: str) -> Array:
        """The times at which it was free."""
        return self.times[~self.locked[:, list(PLACES).index(name)]]


def _parsed(
    builder: DiagramBuilder, stiction_tolerance: float
) -> tuple[MultibodyPlant, SceneGraph, ModelInstanceIndex]:
    config = MultibodyPlantConfig(
        time_step=0.0025,
        discrete_contact_approximation="lagged",
        stiction_tolerance=stiction_tolerance,
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    (model,) = make_parser(plant).AddModelsFromString(_scene(), "sdf")
    return plant, scene_graph, model


def _run(is_locking: bool) -> Ran:
    builder = DiagramBuilder()
    plant, scene_graph, model = _parsed(builder, 1e-4)
    plant.Finalize()
    way = SPEED * (STOPS - STARTS)
    times = [0.0, STARTS, STOPS, LEAVES, LEAVES + 0.5, END]
    places = [0.0, 0.0, way, way, way - 0.05, way - 0.05]
    line = PiecewisePolynomial.FirstOrderHold(times, np.array([places]))
    finger = builder.AddSystem(TrajectorySource(line, output_derivative_order=1))
    builder.Connect(finger.get_output_port(), plant.get_desired_state_input_port(model))
    simulator = Simulator(builder.Build())
    context = plant.GetMyContextFromRoot(simulator.get_mutable_context())
    bodies = [plant.GetBodyByName(name) for name in PLACES]
    resting = RestingBodies(plant, scene_graph, bodies)
    if is_locking:
        simulator.set_monitor(resting.after_step)
    simulator.Initialize()
    rows = []
    for time in np.arange(0.0, END, 0.02):
        simulator.AdvanceTo(time)
        p = [body.EvalPoseInWorld(context).translation() for body in bodies]
        rows.append((time, p, resting.locked))
    return Ran(*map(np.array, zip(*rows, strict=True)))


@pytest.fixture(scope="module")
def locking() -> Ran:
    return _run(is_locking=True)


@pytest.fixture(scope="module")
def free() -> Ran:
    return _run(is_locking=False)


def test_what_rests_is_locked_and_stays(locking: Ran) -> None:
    before = locking.times < MEETS - 0.1
    assert locking.locked[before][:, :-1].all()
    assert np.ptp(locking.places[before][:, :-1], axis=0).max() == 0.0


def test_what_is_pushed_and_what_touches_it_is_free_before_it_is_met(locking: Ran) -> None:
    for name in ("lower", "upper", "beside"):
        assert MEETS - 0.1 < locking.free(name).min() < MEETS


def test_what_is_about_to_be_met_by_a_moving_body_is_free(locking: Ran) -> None:
    gap = locking.place("next")[:, 0] - locking.place("beside")[:, 0] - EDGE
    met = locking.times[np.flatnonzero(gap < 1e-4)[0]]
    assert met - 0.2 < locking.free("next").min() < met


def test_what_is_far_stays_locked(locking: Ran) -> None:
    assert len(locking.free("far")) == 0


def test_all_are_locked_again_once_they_rest_and_nothing_is_near(locking: Ran) -> None:
    pressed = (locking.times > STOPS) & (locking.times < LEAVES)
    assert not locking.locked[pressed][:, :3].any()
    assert locking.locked[locking.times > LEAVES + 1.0][:, :-1].all()


def test_one_body_is_always_free(locking: Ran) -> None:
    assert not locking.locked.all(axis=1)[1:].any()


def test_bodies_move_as_without_locks(locking: Ran, free: Ran) -> None:
    assert free.place("beside")[-1, 0] - free.place("beside")[0, 0] > 0.04
    assert not free.locked.any()
    np.testing.assert_allclose(locking.places, free.places, atol=2e-4)


def test_no_body_creeps_on_and_on_because_it_alone_is_free() -> None:
    """On a slope friction that is simulated lets all of them creep by .6 mm/s."""
    builder = DiagramBuilder()
    plant, scene_graph, model = _parsed(builder, 1e-3)
    plant.mutable_gravity_field().set_gravity_vector(9.81 * np.array([0.0, 0.3, -0.95]))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyContextFromRoot(simulator.get_mutable_context())
    plant.get_desired_state_input_port(model).FixValue(
        plant.GetMyMutableContextFromRoot(simulator.get_mutable_context()), np.zeros(2)
    )
    bodies = [plant.GetBodyByName(name) for name in PLACES]
    simulator.set_monitor(RestingBodies(plant, scene_graph, bodies).after_step)
    simulator.AdvanceTo(2.0)
    p = [body.EvalPoseInWorld(context).translation() for body in bodies]
    moved = np.linalg.norm(np.array(p) - [*PLACES.values()], axis=1)
    assert moved.max() < 4e-4
    assert moved.sum() > 8e-4  # They do creep.
