"""What the functions that build a station share."""

from dataclasses import dataclass

from crossmodal.diagrams.clutter.scenario import Scenario
from crossmodal.diagrams.stations import wiring


@dataclass(kw_only=True)
class StationWiring(wiring.StationWiring):
    """As in every station, with this application's scenario."""

    scenario: Scenario
