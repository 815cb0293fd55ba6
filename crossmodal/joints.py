"""Joints from poses of any tracker: one call on arrays, without a robot, a simulator or Drake.

    from crossmodal import joints

    found = joints.estimate(times, X_PB)
    print(found.type, found.probability, found.axis_P, found.limits)

- `estimate`: the joint of one body, from arrays; `read_track` and `estimate_track` from a file.
- `estimate_repeats`: one joint from several tracks of one object.
- `doubts`: what of an estimate's input looks like a mistake, in sentences.
- `relative_track`: of a body on a parent that moves, too.
- `to_urdf`, `to_sdf`: the joint as a model.
"""

from crossmodal.systems.port_values import JointType
from crossmodal.systems.pose_tracks.doubts import doubts
from crossmodal.systems.pose_tracks.joint_estimate import JointEstimate, estimate, estimate_track
from crossmodal.systems.pose_tracks.joint_model import to_sdf, to_urdf
from crossmodal.systems.pose_tracks.pose_track import PoseTrack, pose_track, relative_track
from crossmodal.systems.pose_tracks.repeats import estimate_repeats
from crossmodal.systems.pose_tracks.track_files import read_track

__all__ = [
    "JointEstimate",
    "JointType",
    "PoseTrack",
    "doubts",
    "estimate",
    "estimate_repeats",
    "estimate_track",
    "pose_track",
    "read_track",
    "relative_track",
    "to_sdf",
    "to_urdf",
]
