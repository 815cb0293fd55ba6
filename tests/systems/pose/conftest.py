"""Targets that the tests of this folder share; lets them import the folder's modules."""

import sys
from pathlib import Path

import pytest
import trimesh

sys.path.append(str(Path(__file__).parent))

from targets import HALF, RADIUS, target

from crossmodal.systems.pose.target_model import TargetModel


@pytest.fixture(scope="session")
def box() -> TargetModel:
    return target(trimesh.creation.box(extents=2.0 * HALF))


@pytest.fixture(scope="session")
def ball() -> TargetModel:
    return target(trimesh.creation.icosphere(subdivisions=5, radius=RADIUS))
