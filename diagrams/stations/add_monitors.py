"""The monitors between what the sensors send and the filters that read it."""

from collections.abc import Mapping, Sequence

from pydrake.systems.framework import DiagramBuilder, InputPort, System

from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.systems.monitoring.image_monitor import ImageMonitor, ImageMonitorConfig
from crossmodal.systems.monitoring.offsets import OffsetModel
from crossmodal.systems.monitoring.window_monitor import WindowMonitor, WindowMonitorConfig


def add_window_monitor(
    builder: DiagramBuilder,
    stream: str,
    size: int,
    config: WindowMonitorConfig,
    model: OffsetModel,
    readers: Sequence[InputPort],
) -> System:
    """Adds the monitor of a stream of samples; exports `<stream>_window` and its health.

    Args:
        stream: Its name.
        model: How offsets are found.
        readers: Of the samples that can be true.
    """
    monitor = builder.AddNamedSystem(f"{stream}_monitor", WindowMonitor(config, size, model))
    builder.ExportInput(monitor.GetInputPort("window"), f"{stream}_window")
    for reader in readers:
        builder.Connect(monitor.GetOutputPort("window_checked"), reader)
    builder.ExportOutput(monitor.GetOutputPort("health_latest"), f"{stream}_health_latest")
    return monitor


def add_image_monitor(
    builder: DiagramBuilder,
    config: ImageMonitorConfig,
    calibration: Calibration,
    readers: Mapping[str, Sequence[System]],
    masked: System,
) -> System:
    """Adds the monitor of a camera's images; exports these, the robot's mask and their health.

    Args:
        calibration: Of the only camera.
        readers: Of the images that can be true, by stream: `color`, `depth`.
        masked: Who reads `robot_mask`, too.
    """
    intrinsics = calibration.camera.intrinsics
    monitor = builder.AddNamedSystem(
        "image_monitor", ImageMonitor(config, intrinsics.width, intrinsics.height)
    )
    for stream, systems in readers.items():
        port = f"{stream}_measured"
        builder.ExportInput(monitor.GetInputPort(port), port)
        for reader in systems:
            builder.Connect(monitor.GetOutputPort(f"{stream}_checked"), reader.GetInputPort(port))
        health = f"{stream}_health_latest"
        builder.ExportOutput(monitor.GetOutputPort(health), health)
    mask = builder.ExportInput(masked.GetInputPort("robot_mask"), "robot_mask")
    builder.ConnectInput(mask, monitor.GetInputPort("robot_mask"))
    return monitor
