from pathlib import Path

import numpy as np
import pytest

from crossmodal.diagrams.crossmodal.inspection.report import report
from crossmodal.plants.object_import.inspection import Inspection, JointFacts


@pytest.mark.parametrize(
    ("kind", "expected"), [("prismatic", "0 to 0.4 m"), ("revolute", "0 to 1.57 rad (0 to 90 deg)")]
)
def test_a_limit_at_zero_has_no_sign(kind: str, expected: str) -> None:
    joint = JointFacts(
        name="hinge",
        kind=kind,
        parent="frame",
        child="door",
        lower=-0.0,
        upper=0.4 if kind == "prismatic" else 0.5 * np.pi,
        moves=True,
    )
    found = Inspection(links=[], joints=[joint], frames={}, handles=[], size=np.zeros(3))
    text = "\n".join(report(found, Path("door.sdf")))
    assert expected in text
    assert "-0" not in text
