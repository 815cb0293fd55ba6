"""The joint filters work without Drake, and whoever imports them waits for little else."""

import subprocess
import sys


def test_the_joint_filters_import_neither_drake_nor_what_only_draws_or_tests() -> None:
    heavy = ("pydrake", "cv2", "matplotlib", "pandas", "scipy.stats", "torch", "trimesh")
    code = (
        "import sys; import crossmodal.systems.kinematics.joint_filters;"
        f"print(*({set(heavy)} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert found.stdout.split() == []
