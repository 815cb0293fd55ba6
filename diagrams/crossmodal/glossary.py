"""What the words of the cross-modal application's tables mean."""

GLOSSARY = {
    "vision": "The estimators that have only the camera's colour and depth images.",
    "proprioception": (
        "The estimators that have only what the arm feels: its joint encoders, the wrench at the"
        " wrist, and the air pressure in the fingers."
    ),
    "cross-modal": "The estimators that have both, and pass predictions between them.",
    "joint type": (
        "What the object can do: slide (prismatic), turn (revolute), turn and move along the same"
        " axis (screw), nothing (rigid) or anything (disconnected)."
    ),
    "configuration": (
        "How far the joint is open: a drawer's travel or a door's angle since the hand took hold."
    ),
    "axis": "The line along which the object slides or about which it turns.",
    "axis distance": "How far the estimated axis passes beside the true one.",
    "pitch": "How far a screw moves along its axis for an angle.",
    "turning point": (
        "The instant at which the object is opened furthest, before the robot brings it back. Here"
        " an axis that is a little off shows most."
    ),
    "exploration error": (
        "How far from the goal the object truly was when the robot, by its own estimate, had"
        " reached it."
    ),
    "exploitation error": (
        "How far from the start the object truly was after the robot had brought it back by the"
        " joint that it had estimated."
    ),
    "settled": "From then on the most probable joint type was the right one until the end.",
    "friction": "The force that the joint takes to be moved at the speed at which it was moved.",
    "end stops": "The configurations at which the joint can go no further.",
}
