"""The segmentation network in PyTorch, which only its training imports.

The encoder is that of MobileNetV2, narrower: inverted residuals, to a sixteenth of the image. There
a gate from the whole image weighs the channels, as in LR-ASPP of MobileNetV3. The decoder adds what
the encoder had at each size before, up to half of the image: a marker is four pixels wide.

Sources: M. Sandler et al., MobileNetV2, CVPR 2018; A. Howard et al., Searching for MobileNetV3,
ICCV 2019, section 6.3.
"""

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from crossmodal.systems.segmentation.network_input import CLASSES, SHAPE

_WIDTHS = 16, 24, 32, 64, 96  # Channels at 1/2, 1/4, 1/8, 1/16, and deeper at 1/16.
_DEPTHS = 1, 2, 3, 3, 2  # Blocks there.
_EXPANSION = 4
_DECODED = 32  # Channels of the decoder.


def _convolution(n_in: int, n_out: int, size: int, stride: int = 1, groups: int = 1) -> nn.Module:
    return nn.Sequential(
        nn.Conv2d(n_in, n_out, size, stride, size // 2, groups=groups, bias=False),
        nn.BatchNorm2d(n_out),
        nn.ReLU(inplace=True),
    )


class _InvertedResidual(nn.Module):
    def __init__(self, n_in: int, n_out: int, stride: int) -> None:
        super().__init__()
        wide = _EXPANSION * n_in
        self.is_residual = stride == 1 and n_in == n_out
        self.layers = nn.Sequential(
            _convolution(n_in, wide, 1),
            _convolution(wide, wide, 3, stride, groups=wide),
            nn.Conv2d(wide, n_out, 1, bias=False),
            nn.BatchNorm2d(n_out),
        )

    def forward(self, x: Tensor) -> Tensor:
        y = self.layers(x)
        return x + y if self.is_residual else y


class SegmentationNetwork(nn.Module):
    """From `network_input` (N, 6, H, W) to logits of `CLASSES` (N, 14, H/2, W/2)."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = _convolution(SHAPE[0], _WIDTHS[0], 3, 2)
        self.stages = nn.ModuleList()
        n_in = _WIDTHS[0]
        for stage, (n_out, depth) in enumerate(zip(_WIDTHS, _DEPTHS, strict=True)):
            strides = [2 if stage in (1, 2, 3) else 1, *[1] * (depth - 1)]
            widths = [n_in, *[n_out] * (depth - 1)]
            self.stages.append(
                nn.Sequential(
                    *(_InvertedResidual(w, n_out, s) for w, s in zip(widths, strides, strict=True))
                )
            )
            n_in = n_out
        self.deep = _convolution(n_in, _DECODED, 1)
        self.gate = nn.Sequential(
            nn.AdaptiveAvgPool2d(1), nn.Conv2d(n_in, _DECODED, 1), nn.Sigmoid()
        )
        self.sides = nn.ModuleList(nn.Conv2d(width, _DECODED, 1) for width in _WIDTHS[2::-1])
        self.joins = nn.ModuleList(
            nn.Sequential(
                _convolution(_DECODED, _DECODED, 3, groups=_DECODED),
                _convolution(_DECODED, _DECODED, 1),
            )
            for _ in self.sides
        )
        self.classes = nn.Conv2d(_DECODED, len(CLASSES), 1)

    def forward(self, x: Tensor) -> Tensor:
        x, kept = self.stem(x), []
        for stage in self.stages:
            x = stage(x)
            kept.append(x)
        y = self.deep(x) * self.gate(x)
        for side, join, before in zip(self.sides, self.joins, kept[2::-1], strict=True):
            y = join(nn.functional.interpolate(y, scale_factor=2.0) + side(before))
        return self.classes(y)


def make_network(seed: int) -> SegmentationNetwork:
    """A network that has not learned anything yet."""
    torch.manual_seed(seed)
    network: Any = SegmentationNetwork()
    return network.to(memory_format=torch.channels_last)


def export(network: SegmentationNetwork, file: Path) -> None:
    """Writes a network as an ONNX file for images (1, 6, 240, 320)."""
    network.eval()
    options: dict[str, Any] = {"input_names": ["x"], "output_names": ["y"], "opset_version": 17}
    torch.onnx.export(network, (torch.zeros(1, *SHAPE),), str(file), dynamo=False, **options)
