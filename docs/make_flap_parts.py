"""Draws how flap and bracket are told apart by their normals, as Fig. 5 of the paper does.

    python docs/make_flap_parts.py [docs/images/flap_parts.png]

It simulates the beginning of one episode (flap, seed 0) and segments two of its depth images.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U

from crossmodal import load_scenario, run_episode
from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.diagrams.run.believed import depth_camera
from crossmodal.diagrams.run.sensor_streams.log import SensorLog, make_streams
from crossmodal.systems.depth_camera import at_image
from crossmodal.systems.flap.tracking.flap_region import crop, fit_local_planes, normals
from crossmodal.systems.flap.tracking.normal_histogram import normal_histogram
from crossmodal.systems.flap.tracking.tool_segmentation import segment
from crossmodal.systems.port_values import StampedImage

CHANGES = ["seed=0", "duration=18", "modalities=[geometric]"]
TURNED = np.deg2rad([3.0, 35.0])  # Of the flap, in the two images.
_PARTS = "#0077BB", "#EE7733"


def main(path: Path) -> None:
    """Simulates and draws."""
    application, scenario = load_scenario("flap", CHANGES)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "sensors.mcap"
        record = run_episode(application, scenario, sensors_file=file)
        size = 640, 480
        models = {
            "depth_measured": StampedImage(time=0.0, image=ImageDepth32F(*size)),
            "robot_mask": ImageGrey8U(*size),
        }
        log = SensorLog(
            file, make_streams(models, application.topics(scenario), record.calibration)
        )
        with mpl.rc_context({**STYLE, "axes.grid": False}):
            figure = new_figure(7.0, 5.6)
            for column, turned in zip(figure.subplots(2, 2).T, TURNED, strict=True):
                index = next(
                    k
                    for k, tick in enumerate(record.station)
                    if tick.values["cheat_flap"].theta >= turned
                )
                time = record.station[index].time
                finger = record.estimators["geometric"].ticks[index].values
                values = log.read(time, scenario.network_period)
                _draw(column, values, finger["fingertip_contact_latest"].p_WC, scenario, record)
                column[0].set_title(f"flap turned by {np.rad2deg(turned):.0f} deg")
            figure.savefig(path, dpi=110)


def _draw(
    column: tuple[Axes, Axes], values: dict[str, Any], p_WC: Any, scenario: Any, record: Any
) -> None:
    """The parts in the depth image, above the histogram of its normals."""
    config = scenario.perception.tracker
    seen = values["depth_measured"]
    camera = at_image(depth_camera(record.calibration), seen)
    mask = values["robot_mask"].data[:, :, 0]
    image = crop(seen.image.data[:, :, 0], mask, camera, p_WC, config.region.radius)
    assert image is not None
    focal = camera.intrinsics.focal_x
    parts = segment(image, focal, config, config.sensor.first_scale)
    grey = np.where(image.valid, 0.55, 1.0)[:, :, None] * np.ones(3)
    for fit, color in zip(parts.fits, _PARTS, strict=False):
        grey[fit.pixels] = to_rgb(color)
    column[0].imshow(grey)
    column[0].set_axis_off()
    z = 1.0 / float(np.median(image.w[image.valid]))
    planes = fit_local_planes(
        image, round(config.window * focal / z), config.stride, config.window_share
    )
    smooth = planes.mean_square < (config.window_residual * parts.sigma) ** 2
    column[1].imshow(
        normal_histogram(normals(planes.m_C[smooth])),
        extent=(-1.0, 1.0, 1.0, -1.0),
        cmap="Greys",
    )
    column[1].set_xlabel("y of the normal in the camera's frame")
    column[1].set_ylabel("x")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/flap_parts.png"))
