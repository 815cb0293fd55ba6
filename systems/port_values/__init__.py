"""The values that flow between perception systems, one small class per kind of thing.

Frames: W world (the robot's base is calibrated in it), C camera (x right, y down, z forward),
E nominal end-effector, H bent end-effector, S wrist sensor, B a moving body, P a joint's parent.

Poses are (4, 4) matrices. An uncertain pose is X = X_mean exp(xi), xi ~ N(0, covariance): the error
is expressed in the moving frame, rotation [rad] before translation [m]. A body's frame B has the
world's axes and sits near the body at the reference, the instant before it first moved; its
covariance is that of the displacement since then.

Port values are read-only: what `Eval` returns is shared by all readers.
"""

from crossmodal.systems.port_values.bodies import (
    HELD_BODY,
    STATIC_BODY,
    BodyMotion,
    BodyMotions,
    BodyPrediction,
    BodyPredictions,
    ExpectedFeatures,
    FeatureBelief,
    HeldBody,
    no_expectations,
    no_features,
)
from crossmodal.systems.port_values.declutter import (
    NO_ACTION,
    NO_GRAPH,
    NO_GRASPS,
    NO_MASKS,
    NO_OFFSET,
    NO_PROGRESS,
    NO_SEGMENTS,
    NO_TRIES,
    ActionRequest,
    ArmOffset,
    DeclutterAction,
    DeclutterGraph,
    DeclutterProgress,
    DeclutterStep,
    DeclutterVertex,
    Grasp,
    Grasps,
    ObjectMasks,
    Push,
    Segment,
    Segments,
    Tries,
)
from crossmodal.systems.port_values.flap import (
    UNKNOWN_ANGLE,
    UNKNOWN_HINGE,
    UNKNOWN_TOOL,
    FlapAngleBelief,
    FlapPlane,
    HingeBelief,
    ToolBelief,
    unseen,
)
from crossmodal.systems.port_values.grasp import (
    NO_SLIP,
    UNKNOWN_LOAD,
    GraspBelief,
    GraspType,
    HandLoad,
    SlipBelief,
)
from crossmodal.systems.port_values.joints import (
    MOVING_TYPES,
    DetentBelief,
    JointBelief,
    JointBeliefs,
    JointFit,
    JointMechanics,
    JointMechanicsBelief,
    JointMechanicsBeliefs,
    JointModelBelief,
    JointType,
    LimitBelief,
)
from crossmodal.systems.port_values.motions import (
    IN_PLACE,
    NO_POSE,
    UNKNOWN_END_EFFECTOR,
    CameraDisplacement,
    EndEffectorBelief,
    MotionBelief,
    PoseBelief,
)
from crossmodal.systems.port_values.pose import (
    NO_MEASUREMENT,
    NO_PRIOR,
    NO_TOUCH,
    NO_VIEW,
    UNKNOWN_POSE,
    Bodies,
    ObjectPose,
    PoseMeasurement,
    PosePrior,
    TouchRequest,
    ViewRequest,
    deviations,
    has_settled,
    of_mesh,
    of_middle,
)
from crossmodal.systems.port_values.registration import (
    DisplacementBelief,
    displacement_at,
    unknown_displacements,
)
from crossmodal.systems.port_values.streams import (
    HEALTHY,
    SampleWindow,
    StampedImage,
    StreamHealth,
    no_samples,
)
from crossmodal.systems.port_values.tactile import (
    NO_CONTACT,
    UNKNOWN_FINGERTIP,
    FingertipContact,
    TactileContact,
)
