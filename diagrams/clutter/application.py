"""The clutter application: where a known object is, by views and touches that teach most.

Source: "Active Visuo-Tactile Interactive Robotic Perception for Accurate Object Pose Estimation in
Dense Clutter", sections II-C and II-D.
"""

from pydrake.math import RigidTransform

from crossmodal.diagrams.clutter.controls import make_controls
from crossmodal.diagrams.clutter.estimator_names import COLORS, LABELS
from crossmodal.diagrams.clutter.estimators import (
    make_calibration,
    make_estimators,
)
from crossmodal.diagrams.clutter.glossary import GLOSSARY
from crossmodal.diagrams.clutter.listing import LISTING
from crossmodal.diagrams.clutter.meshcat_view import VIEWPOINT, add_view
from crossmodal.diagrams.clutter.own_mesh import keep_files, own_mesh_assignments
from crossmodal.diagrams.clutter.results.declutter_results import declutter_metrics
from crossmodal.diagrams.clutter.results.results import evaluate, metrics, task_in_words
from crossmodal.diagrams.clutter.scenario import (
    Scenario,
    object_names,
    resolve,
)
from crossmodal.diagrams.clutter.station.station import close_loop, make_station
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import Column
from crossmodal.diagrams.run.record import Quantity
from crossmodal.plants.goods.clutter_density import NO_DENSITY
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_MASKS,
    NO_MEASUREMENT,
    NO_OFFSET,
    NO_PROGRESS,
    NO_TOUCH,
    NO_VIEW,
    UNKNOWN_POSE,
)

_OF_CLUTTER = [
    Quantity(port="cheat_clutter_density", model=NO_DENSITY),
    Quantity(port="object_masks", model=NO_MASKS),
    Quantity(port="declutter_graph", model=NO_GRAPH),
    Quantity(port="declutter_progress", model=NO_PROGRESS),
    Quantity(port="arm_offset", model=NO_OFFSET),
]

APPLICATION = Application(
    name=LISTING.name,
    description=LISTING.description,
    scenario=Scenario,
    scenarios=LISTING.scenarios,
    resolve=resolve,
    make_calibration=make_calibration,
    make_station=make_station,
    make_estimators=make_estimators,
    close_loop=close_loop,
    own_object=own_mesh_assignments,
    keep_files=keep_files,
    quantities=lambda scenario: [Quantity(port="object_pose_latest", model=UNKNOWN_POSE)],
    station_quantities=lambda scenario: [
        *(
            Quantity(port=f"cheat_{name}_pose", model=RigidTransform())
            for name in ["object", *object_names(scenario)]
        ),
        Quantity(port="pose_measurement", model=NO_MEASUREMENT),
        Quantity(port="touch_latest", model=NO_TOUCH),
        Quantity(port="view_latest", model=NO_VIEW),
        *(_OF_CLUTTER if scenario.clutter.count else []),
    ],
    evaluate=evaluate,
    task_in_words=task_in_words,
    view=add_view,
    viewpoint=VIEWPOINT,
    film=lambda scenario: ["color_measured"] if scenario.station == "robots" else [],
    controls=make_controls,
    glossary=GLOSSARY,
    portrait="stages.png",
    labels=LABELS,
    colors=COLORS,
    metrics=[*metrics(), *declutter_metrics()],
    experiments=LISTING.experiments,
    overview=[Column(header="ADI at the end", metric="adi", estimator="density")],
)
