"""Networks that map images to images, from ONNX files: PyTorch only trains them."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnxruntime

Images = npt.NDArray[np.float32]


class OnnxNetwork:
    """A network with one input and one output.

    Args:
        path: Of the file.
        shape: Channels, height and width (C, H, W) of the images that it is for.

    Raises:
        FileNotFoundError: where there is no such file.
        ValueError: for a file that is no network, or cannot be run on such images.
    """

    def __init__(self, path: Path, shape: tuple[int, int, int]) -> None:
        if not path.is_file():
            raise FileNotFoundError(f"{path}: there is no such file of a network")
        self._path, self._shape = path, shape
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1  # Sums are the same on machines of any number of cores.
        try:
            self._session = onnxruntime.InferenceSession(
                path.read_bytes(), options, providers=["CPUExecutionProvider"]
            )
            (self._input,) = self._session.get_inputs()
            self(np.zeros((1, *shape), np.float32))
        except Exception as error:  # ONNX Runtime has no common class of its errors.
            raise ValueError(f"{path}: no network for images of the shape {shape}") from error

    def __call__(self, x: Images) -> Images:
        """Runs it on images (N, C, H, W), one after the other; returns (N, C', H', W').

        Raises:
            ValueError: for images of another shape than it was made for, and for none.
        """
        if x.ndim != 4 or x.shape[1:] != self._shape or len(x) == 0:
            raise ValueError(f"{self._path.name}: need images (N, *{self._shape}), got {x.shape}")
        images = np.ascontiguousarray(x, np.float32)
        each = [self._session.run(None, {self._input.name: image[None]})[0] for image in images]
        return np.concatenate(each)
