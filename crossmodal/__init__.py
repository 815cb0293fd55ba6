"""Interactive perception in Drake: a robot moves something and reads what its senses say together.

The names below are imported when they are first used, so that `import crossmodal` costs nothing.

- `joints`: the joint of a body from poses of any tracker, in one call; `JointFilters` and
  `JointFiltersConfig` take one pose after the other.
- `estimate_pose`: where a known object is, from a cloud and contact points.
- `load_scenario`, `run_episode`, `replay`, `read_run`: episodes, and what they leave.
- `Application`, `Scenario`, `Station`: what an application of one's own is made of.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from crossmodal.diagrams.applications import load_scenario, read_run
    from crossmodal.diagrams.run.application import Application, Station
    from crossmodal.diagrams.run.episode import run_episode
    from crossmodal.diagrams.run.replay import replay
    from crossmodal.diagrams.run.scenario import Scenario
    from crossmodal.systems.kinematics.joint_filters import JointFilters
    from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig
    from crossmodal.systems.pose.recorded_pose import estimate_pose

__all__ = [
    "Application",
    "JointFilters",
    "JointFiltersConfig",
    "Scenario",
    "Station",
    "estimate_pose",
    "load_scenario",
    "read_run",
    "replay",
    "run_episode",
]

_MODULES = {
    "Application": "diagrams.run.application",
    "JointFilters": "systems.kinematics.joint_filters",
    "JointFiltersConfig": "systems.kinematics.joint_filters_config",
    "Scenario": "diagrams.run.scenario",
    "Station": "diagrams.run.application",
    "estimate_pose": "systems.pose.recorded_pose",
    "load_scenario": "diagrams.applications",
    "read_run": "diagrams.applications",
    "replay": "diagrams.run.replay",
    "run_episode": "diagrams.run.episode",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'crossmodal' has no attribute '{name}'")
    return getattr(importlib.import_module(f"crossmodal.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
