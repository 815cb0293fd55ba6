"""What there is to be run, known without importing what runs it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from crossmodal.diagrams.run.experiment import Experiment
from crossmodal.diagrams.run.yaml_input.loader import read_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

_MOST_BASES = 20  # Of scenarios on top of each other.


@dataclass(frozen=True, kw_only=True)
class Listing:
    """An application's scenarios and experiments.

    Attributes:
        name: Of the application.
        description: Of it, one line.
        scenarios: Folder of its scenarios.
        experiments: By name.
        object_options: What `crossmodal run` may be told of an object of the user's own, by the
            options' names in Python; None where there can be none.
    """

    name: str
    description: str
    scenarios: Path
    experiments: Mapping[str, Experiment] = field(default_factory=dict)
    object_options: Sequence[str] | None = None

    def files(self) -> dict[str, Path]:
        """Its scenarios' files by name; model directives are none."""
        files = sorted(self.scenarios.glob("*.yaml"), key=lambda path: path.stem)
        return {path.stem: path for path in files if not path.name.endswith(".dmd.yaml")}


def description_of(path: Path, known: Mapping[str, Path]) -> str:
    """What a scenario's file, or the one that it is based on, says that it is; or why not.

    Args:
        path: Of the file.
        known: Files of the scenarios that have names.
    """
    try:
        return said_in(path, "description", known)
    except ScenarioError as error:
        return f"cannot be read: {error}"


def said_in(path: Path, key: str, known: Mapping[str, Path]) -> str:
    """What a scenario's file, or the one that it is based on, says of a key; empty: nothing.

    Args:
        path: Of the file.
        key: Of the scenario itself, with a text.
        known: Files of the scenarios that have names.

    Raises:
        ScenarioError: where a file cannot be read.
    """
    for _ in range(_MOST_BASES):
        document = read_yaml(path)
        base = document.get("base")
        if key in document or not isinstance(base, str):
            return str(document.get(key) or "")
        beside = [path.parent / base, path.parent / f"{base}.yaml"]
        path = next((file for file in beside if file.is_file()), known.get(base, Path(base)))
    return ""
