"""Scenarios of the flap application, read as the program reads them."""

from collections.abc import Callable

import pytest

from crossmodal.diagrams.flap.scenario import SCENARIO_FOLDER, Scenario, resolve
from crossmodal.diagrams.run.scenario import parse_scenario, read_document

Load = Callable[..., Scenario]


@pytest.fixture(scope="session")
def load() -> Load:
    def load_scenario(name: str, *overrides: str) -> Scenario:
        path = SCENARIO_FOLDER / f"{name}.yaml"
        return resolve(parse_scenario(Scenario, read_document(path, overrides), path), path)

    return load_scenario
