"""Sends what estimators believe and what cameras see to a viewer, tick by tick."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.calibration import Calibration, CameraCalibration
from crossmodal.diagrams.run.folder.run_folder import without_nan
from crossmodal.diagrams.run.record import Quantity, TaskStatus, Tick
from crossmodal.diagrams.run.recorder import STATUS_PORT, declare_input, read_inputs
from crossmodal.diagrams.run.sensor_streams.codecs import nanoseconds
from crossmodal.diagrams.run.stream.messages import (
    camera_message,
    image,
    markers,
    pose_with_covariance,
    transforms,
)
from crossmodal.diagrams.run.stream.sinks import Sink
from crossmodal.systems.object_models.articulated_object import ArticulatedObject
from crossmodal.systems.port_values import MotionBelief, ObjectPose, StampedImage

_GREY = "#888888"


def joint_messages(found: ArticulatedObject) -> dict[str, Any]:
    """An object's joints as JSON: what `ObjectJoint` holds, the axis and a point on it.

    Frames are those of the object's bodies; SI units.
    """
    joints = []
    for joint in found.joints:
        values = dataclasses.asdict(joint)
        values |= {"axis": joint.axis_P, "point": joint.p_PA if joint.turns else np.full(3, np.nan)}
        joints.append(
            {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}
        )
    known: dict[str, Any] = without_nan({"time": found.time, "joints": joints})
    return known


def image_ports(models: Mapping[str, Any]) -> dict[str, StampedImage]:
    """The ports that give colour or depth images as the robot has them."""
    return {
        port: model
        for port, model in models.items()
        if isinstance(model, StampedImage)
        and isinstance(model.image, ImageRgba8U | ImageDepth32F)
        and not port.startswith("cheat_")
    }


class EstimateStream(LeafSystem):
    """Sends images, cameras, frames, joints and the robot's task as messages.

    Like the recorder it reads the estimators half a period after their tick, and stamps what they
    say with the tick's time. Topics:

    - an image's own, with `camera_info` beside it, when there is a new image;
    - `/tf`: the cameras, and `<estimator>/<body>` of each body that is perceived;
    - `/<estimator>/joints`, as JSON, and `/<estimator>/markers`, which draw them;
    - `/<estimator>/object_pose`, where an object's pose is sought, once it is known, and its frame;
    - `/task`: what the robot does, as JSON.

    Input ports:
    - `<image>`: `StampedImage` of each image; `task_status`: `TaskStatus`.
    - `<estimator>_<port>`: each quantity of each estimator that has it.

    What has no source stays unconnected.

    Args:
        sink: Takes the messages.
        quantities: Of the estimators.
        estimators: Names.
        models: Of the station's ports, by port, among which are the images.
        start: What is added to the time since the start in all stamps, [ns].
    """

    def __init__(
        self,
        sink: Sink,
        application: Application,
        scenario: Any,
        calibration: Calibration,
        quantities: Sequence[Quantity],
        estimators: Sequence[str],
        models: Mapping[str, Any],
        start: int = 0,
    ) -> None:
        super().__init__()
        self._sink, self._application = sink, application
        self._world, self._start = calibration.world, start
        topics = application.topics(scenario)
        self._images = {
            port: (
                declare_input(self, port, model),
                topics[port].name if port in topics else f"/{port}",
                _name_and_camera(calibration, port),
            )
            for port, model in image_ports(models).items()
        }
        self._status = {STATUS_PORT: declare_input(self, STATUS_PORT, TaskStatus())}
        self._ports = {
            name: {
                q.port: declare_input(self, f"{name}_{q.port}", q.model)
                for q in quantities
                if not q.estimators or name in q.estimators
            }
            for name in estimators
        }
        self._seen: dict[str, float] = {}
        self._known: dict[str, ArticulatedObject | None] = dict.fromkeys(estimators)
        self._time, self._doing = 0.0, ""
        period = scenario.network_period
        self.DeclarePeriodicPublishEvent(period, 0.0, self._send_station)
        self.DeclarePeriodicPublishEvent(period, 0.5 * period, self._send_beliefs)

    def _send_station(self, context: Context) -> None:
        self._time = context.get_time()
        now = self._start + nanoseconds(self._time)
        for name, (port, topic, (frame, camera)) in self._images.items():
            if not port.HasValue(context):
                continue
            value: StampedImage = port.Eval(context)
            if value.time == self._seen.get(name) or not value.image.data.size:
                continue
            self._seen[name] = value.time
            taken = max(self._start + nanoseconds(value.time), 0)
            self._sink.write(topic, image(value.image.data, taken, frame), now)
            if camera is None:
                continue
            beside = f"{topic.rpartition('/')[0]}/camera_info"
            self._sink.write(beside, camera_message(camera.intrinsics, taken, frame), now)
            X_WC = camera.X_PC.GetAsMatrix4() if camera.is_fixed else value.X_WC
            if np.isfinite(X_WC).all():
                self._sink.write("/tf", transforms({frame: X_WC}, now, self._world), now)
        status = read_inputs(self._status, context).get(STATUS_PORT, TaskStatus())
        if status.event and status.event != self._doing:
            self._doing = status.event
            self._sink.write("/task", {"time": self._time, "doing": status.event}, now)

    def _send_beliefs(self, context: Context) -> None:
        now = self._start + nanoseconds(self._time)
        for name, ports in self._ports.items():
            tick = Tick(time=self._time, values=read_inputs(ports, context))
            poses = {
                f"{name}/{port.removesuffix('_latest')}": value.X
                for port, value in tick.values.items()
                if isinstance(value, MotionBelief)
            }
            for port, value in tick.values.items():
                if isinstance(value, ObjectPose) and value.known:
                    topic = f"{name}/{port.removesuffix('_latest')}"
                    poses[topic] = value.X_WO
                    message = pose_with_covariance(value, now, self._world)
                    self._sink.write(f"/{topic}", message, now)
            if self._application.perceived is not None:
                self._known[name] = self._application.perceived(self._known[name], tick)
            found = self._known[name]
            if found is not None:
                poses |= {f"{name}/{found.root}": found.X_WR}
                poses |= {f"{name}/{body.name}": body.X_WB for body in found.bodies}
                color = self._application.colors.get(name, _GREY)
                self._sink.write(f"/{name}/joints", joint_messages(found), now)
                drawn = markers(found, now, color, self._world)
                self._sink.write(f"/{name}/markers", drawn, now)
            if poses:
                self._sink.write("/tf", transforms(poses, now, self._world), now)


def _name_and_camera(calibration: Calibration, port: str) -> tuple[str, CameraCalibration | None]:
    """The name of the camera that a port is of, for its frame, and what is believed of it."""
    camera = calibration.camera_of(port)
    name = next((n for n, c in calibration.cameras.items() if c is camera), port)
    return name, camera
