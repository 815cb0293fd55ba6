"""The flap application: a tactile fingertip flips the flap of a held tool, whose kinematics is
estimated on the way.

Source: Q. Li, A. Ückermann, R. Haschke and H. Ritter, Estimating an articulated tool's kinematics
via visuo-tactile based robotic interactive manipulation, IROS 2018.
"""

from crossmodal.diagrams.flap.controls import make_controls
from crossmodal.diagrams.flap.episode_parts import (
    QUANTITIES,
    STATION_QUANTITIES,
    TOPICS,
    close_loop,
    make_calibration,
    make_estimators,
)
from crossmodal.diagrams.flap.estimator_names import COLORS, LABELS
from crossmodal.diagrams.flap.glossary import GLOSSARY
from crossmodal.diagrams.flap.listing import LISTING
from crossmodal.diagrams.flap.meshcat_view import VIEWPOINT, add_view
from crossmodal.diagrams.flap.own_tool import keep_files, own_tool_assignments
from crossmodal.diagrams.flap.perceived_tool import perceived_tool
from crossmodal.diagrams.flap.results.metrics import METRICS, OVERVIEW
from crossmodal.diagrams.flap.results.results import evaluate
from crossmodal.diagrams.flap.results.task import task_in_words
from crossmodal.diagrams.flap.scenario import Scenario, resolve
from crossmodal.diagrams.flap.station.station import make_flap_station
from crossmodal.diagrams.run.application import Application

APPLICATION = Application(
    name=LISTING.name,
    description=LISTING.description,
    scenario=Scenario,
    scenarios=LISTING.scenarios,
    resolve=resolve,
    make_calibration=make_calibration,
    make_station=make_flap_station,
    make_estimators=make_estimators,
    close_loop=close_loop,
    quantities=lambda scenario: QUANTITIES,
    station_quantities=lambda scenario: STATION_QUANTITIES,
    pictures=lambda scenario: ("color_measured",),
    topics=lambda scenario: TOPICS,
    evaluate=evaluate,
    perceived=perceived_tool,
    acting=lambda scenario: scenario.acting_estimator,
    task_in_words=task_in_words,
    view=add_view,
    viewpoint=VIEWPOINT,
    controls=make_controls,
    own_object=own_tool_assignments,
    keep_files=keep_files,
    glossary=GLOSSARY,
    portrait="frames.png",
    labels=LABELS,
    colors=COLORS,
    metrics=METRICS,
    experiments=LISTING.experiments,
    overview=OVERVIEW,
)
