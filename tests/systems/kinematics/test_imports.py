"""The joint filters work without Drake, and whoever imports them waits for little else."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["systems.kinematics.joint_filters", "joints"])
def test_the_joint_filters_import_neither_drake_nor_what_only_draws_or_tests(module: str) -> None:
    heavy = ("pydrake", "cv2", "matplotlib", "pandas", "scipy.stats", "torch", "trimesh")
    code = f"import sys; import crossmodal.{module};print(*({set(heavy)} & set(sys.modules)))"
    command = [sys.executable, "-c", code]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert found.stdout.split() == []
