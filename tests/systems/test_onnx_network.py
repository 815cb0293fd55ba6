from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.testing import assert_allclose
from onnx import TensorProto, helper, numpy_helper

from crossmodal.systems.onnx_network import OnnxNetwork

SHAPE = (2, 6, 8)
KERNEL = np.random.default_rng(0).normal(size=(3, 2, 1, 1)).astype(np.float32)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """One convolution with a kernel of one pixel."""
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, *SHAPE[1:]])
        for name, channels in (("x", 2), ("y", 3))
    ]
    node = helper.make_node("Conv", ["x", "kernel"], ["y"])
    kernel = numpy_helper.from_array(KERNEL, "kernel")
    graph = helper.make_graph([node], "network", ends[:1], ends[1:], [kernel])
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(made, tmp_path / "network.onnx")
    return tmp_path / "network.onnx"


def test_each_image_is_mapped_as_the_file_says(file: Path) -> None:
    x = np.random.default_rng(1).normal(size=(3, *SHAPE)).astype(np.float32)
    y = OnnxNetwork(file, SHAPE)(x)
    assert_allclose(y, np.einsum("oc,nchw->nohw", KERNEL[:, :, 0, 0], x), atol=1e-5)


def test_results_stay_what_they_are_when_it_runs_again(file: Path) -> None:
    network = OnnxNetwork(file, SHAPE)
    first = network(np.ones((1, *SHAPE), np.float32))
    network(np.zeros((1, *SHAPE), np.float32))
    assert_allclose(
        first, KERNEL[:, :, 0, 0].sum(axis=1)[None, :, None, None] * np.ones_like(first), atol=1e-6
    )


@pytest.mark.parametrize("shape", [(1, 3, 6, 8), (1, 2, 6, 9), (2, 6, 8), (0, 2, 6, 8)])
def test_images_of_another_shape_are_refused(file: Path, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"network.onnx: need images \(N, \*\(2, 6, 8\)\)"):
        OnnxNetwork(file, SHAPE)(np.zeros(shape, np.float32))


def test_a_file_that_is_none_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="there is no such file"):
        OnnxNetwork(tmp_path / "other.onnx", SHAPE)
    (tmp_path / "text.onnx").write_text("text")
    with pytest.raises(ValueError, match="no network for images of the shape"):
        OnnxNetwork(tmp_path / "text.onnx", SHAPE)
