"""Only training needs PyTorch, the extra `train`; without it its tests are left out."""

from importlib.util import find_spec

collect_ignore = (
    [] if find_spec("torch") else ["test_grasp_training.py", "test_segmentation_training.py"]
)
