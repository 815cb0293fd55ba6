"""The cross-modal application: coupled filters over vision, proprioception and touch find the joint
of an unknown object while a compliant arm explores it.

Source: R. Martín-Martín and O. Brock, Cross-modal interpretation of multi-modal sensor streams in
interactive perception based on coupled recursion, IROS 2017.
"""

from crossmodal.diagrams.crossmodal.controls import make_controls
from crossmodal.diagrams.crossmodal.episode_parts import (
    QUANTITIES,
    TOPICS,
    close_loop,
    make_calibration,
    make_estimators,
    make_station,
)
from crossmodal.diagrams.crossmodal.glossary import GLOSSARY
from crossmodal.diagrams.crossmodal.listing import LISTING
from crossmodal.diagrams.crossmodal.meshcat_view import VIEWPOINT, add_view
from crossmodal.diagrams.crossmodal.modalities import COLORS, LABELS
from crossmodal.diagrams.crossmodal.own_object import keep_files, own_object_assignments
from crossmodal.diagrams.crossmodal.results.grasp_episode import GRASP_QUANTITIES
from crossmodal.diagrams.crossmodal.results.metrics import CAMPAIGN_PLOTS, METRICS, OVERVIEW
from crossmodal.diagrams.crossmodal.results.results import evaluate
from crossmodal.diagrams.crossmodal.scenario import Scenario, resolve
from crossmodal.diagrams.crossmodal.task import task_in_words
from crossmodal.diagrams.joints.joint_truth import MECHANICS_QUANTITY, TRUTH_QUANTITIES
from crossmodal.diagrams.joints.perceived_object import perceived_object
from crossmodal.diagrams.run.application import Application

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
    quantities=lambda scenario: QUANTITIES,
    station_quantities=lambda scenario: (
        *TRUTH_QUANTITIES,
        MECHANICS_QUANTITY,
        *GRASP_QUANTITIES,
    ),
    pictures=lambda scenario: ("color_measured",),
    topics=lambda scenario: TOPICS,
    evaluate=evaluate,
    perceived=perceived_object,
    acting=lambda scenario: scenario.acting_modality,
    task_in_words=task_in_words,
    view=add_view,
    viewpoint=VIEWPOINT,
    controls=make_controls,
    own_object=own_object_assignments,
    keep_files=keep_files,
    glossary=GLOSSARY,
    portrait="frames.png",
    labels=LABELS,
    colors=COLORS,
    metrics=METRICS,
    experiments=LISTING.experiments,
    overview=OVERVIEW,
    campaign_plots=CAMPAIGN_PLOTS,
)
