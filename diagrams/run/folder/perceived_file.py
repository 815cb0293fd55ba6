"""What each estimator of a run perceived of an articulated object in the end, as a file."""

from dataclasses import dataclass, field
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.yaml_input.loader import read_yaml
from crossmodal.diagrams.run.yaml_input.schema import load_typed
from crossmodal.systems.object_models.articulated_object import ArticulatedObject

PERCEIVED_FILE = "perceived.yaml"


@dataclass(kw_only=True)
class Perceived:
    """The object by estimator; one that perceived none is left out."""

    estimators: dict[str, ArticulatedObject] = field(default_factory=dict)


def perceived(application: Application, record: EpisodeRecord) -> Perceived:
    """What the estimators of an episode perceived in the end."""
    found = Perceived()
    if application.perceived is None:
        return found
    for name, estimator in record.estimators.items():
        known: ArticulatedObject | None = None
        for tick in estimator.ticks:
            known = application.perceived(known, tick)
        if known is not None:
            found.estimators[name] = known
    return found


def as_text(found: Perceived) -> str:
    """As YAML."""
    text: str = yaml_dump_typed(found)
    return text


def read_perceived(folder: Path) -> Perceived:
    """What a run has written into its folder.

    Raises:
        ScenarioError: where the file cannot be read or is no such file.
    """
    path = folder / PERCEIVED_FILE
    return load_typed(Perceived, read_yaml(path), str(path))
