"""Networks that map images to images, from ONNX files, run by OpenCV: PyTorch only trains them."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

Images = npt.NDArray[np.float32]


class OnnxNetwork:
    """A network with one input and one output.

    Args:
        path: Of the file.
        shape: Channels, height and width (C, H, W) of the images that it is for; OpenCV does not
            say what the file was made for.

    Raises:
        FileNotFoundError: where there is no such file.
        ValueError: for a file that is no network, or cannot be run on such images.
    """

    def __init__(self, path: Path, shape: tuple[int, int, int]) -> None:
        if not path.is_file():
            raise FileNotFoundError(f"{path}: there is no such file of a network")
        self._path, self._shape = path, shape
        try:
            self._network = cv2.dnn.readNetFromONNX(str(path))
            self(np.zeros((1, *shape), np.float32))
        except cv2.error as error:
            raise ValueError(f"{path}: no network for images of the shape {shape}") from error

    def __call__(self, x: Images) -> Images:
        """Runs it on images (N, C, H, W), one after the other; returns (N, C', H', W').

        Raises:
            ValueError: for images of another shape than it was made for, and for none.
        """
        if x.ndim != 4 or x.shape[1:] != self._shape or len(x) == 0:
            raise ValueError(f"{self._path.name}: need images (N, *{self._shape}), got {x.shape}")
        found = []
        for image in x:
            self._network.setInput(np.ascontiguousarray(image[None], np.float32))
            found.append(self._network.forward().copy())
        return np.concatenate(found)
