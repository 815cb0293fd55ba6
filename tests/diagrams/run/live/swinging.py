"""A pendulum of a few lines that a person may push on the live page."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.drawing.layers import Layers
from crossmodal.diagrams.drawing.meshcat import ROOT, TRUTH, clear_view
from crossmodal.diagrams.evaluation.estimates import evaluate_rows, scalar
from crossmodal.diagrams.run.application import Application, Quantity, Scenario, Station, Viewpoint
from crossmodal.diagrams.run.live.controls import Control
from crossmodal.systems.port_values import SampleWindow
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.sensors.sampled_sensor import SampledSensor

VIEWPOINT = Viewpoint(p_WV=np.array([0.0, -1.5, 0.0]), p_WT=np.array([0.0, 0.0, -0.25]))


@dataclass(kw_only=True)
class Swinging(Scenario):
    pass


class Encoder(SampledSensor):
    def __init__(self, scenario):
        super().__init__("state", "state", 2, 0.01, scenario.network_period)

    def measure(self, value, index):
        return value


class LastAngle(RecursiveFilter):
    def __init__(self, scenario):
        super().__init__()
        window = SampleWindow(times=np.zeros(0), values=np.zeros((0, 2)))
        self._window = self._declare_value_input("state_window", window)
        self._declare_recursion((0.0,), self._update, scenario.network_period)
        self._declare_latest("angle_latest", lambda angle: angle)

    def _update(self, context, angle):
        window = self._read(self._window, context)
        return (float(window.values[-1, 0]),) if len(window.values) else angle


def make_station(scenario, calibration):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.005)
    inertia = SpatialInertia(1.0, [0.0, 0.0, -0.5], UnitInertia(0.3, 0.3, 0.05))
    rod = plant.AddRigidBody("rod", inertia)
    shape = RigidTransform([0.0, 0.0, -0.25])
    plant.RegisterVisualGeometry(rod, shape, Box(0.05, 0.05, 0.5), "rod", [0.8, 0.3, 0.1, 1.0])
    joint = RevoluteJoint("hinge", plant.world_frame(), rod.body_frame(), [0.0, 1.0, 0.0], 0.1)
    plant.AddJointActuator("hand", plant.AddJoint(joint))
    plant.Finalize()
    builder.ExportInput(plant.get_actuation_input_port(), "torque")
    encoder = builder.AddSystem(Encoder(scenario))
    builder.Connect(plant.get_state_output_port(), encoder.get_input_port())
    builder.ExportOutput(encoder.GetOutputPort("state_window"), "state_window")
    builder.ExportOutput(plant.get_state_output_port(), "cheat_state")
    builder.ExportOutput(scene_graph.get_query_output_port(), "cheat_query_object")
    return Station(diagram=builder.Build())


def add_view(builder, scenario, meshcat, station, estimators):
    clear_view(meshcat, VIEWPOINT)
    for path in [TRUTH, *(f"{ROOT}/{name}" for name in estimators)]:
        meshcat.SetObject(f"{path}/ball", Sphere(0.05))
    layers = {f"the {name} one's": f"{ROOT}/{name}" for name in estimators}
    return Layers(estimators=layers, truth=TRUTH)


def rows(estimator, tick, station):
    yield scalar("angle", tick.values["angle_latest"][0], true=station.values["cheat_state"][0])


APPLICATION = Application(
    name="swinging",
    description="a pendulum that a person pushes",
    scenario=Swinging,
    scenarios=Path(__file__).parent,
    make_station=make_station,
    make_estimators=lambda scenario, calibration: {
        name: LastAngle(scenario) for name in ("left", "right")
    },
    quantities=lambda scenario: [Quantity(port="angle_latest", model=(0.0,))],
    station_quantities=lambda scenario: [Quantity(port="cheat_state", model=np.zeros(2))],
    evaluate=partial(evaluate_rows, rows=rows, units={"angle": "rad"}),
    view=add_view,
    viewpoint=VIEWPOINT,
    controls=lambda scenario: [
        Control(name="torque [N m]", port="torque", low=-20.0, high=20.0, step=0.5),
    ],
)
