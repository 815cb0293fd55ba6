"""What README shows in Python runs."""

import re
from pathlib import Path
from typing import Any

from crossmodal.systems.port_values import JointType

README = Path(__file__).parents[1] / "README.md"


def test_poses_of_a_door_are_told_to_be_a_hinge() -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```", README.read_text(), re.DOTALL | re.MULTILINE)
    names: dict[str, Any] = {}
    exec(code, names)
    assert names["belief"].type == JointType.REVOLUTE
    assert abs(names["belief"].model.configuration[0] - 1.78) < 0.01
    assert names["belief"].skipped == {}
