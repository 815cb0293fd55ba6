"""What the words of the flap application's tables mean."""

GLOSSARY = {
    "geometric": (
        "The hinge about which all planes of the flap in the depth images are turned; the robot"
        " acts by this estimator."
    ),
    "joint filters": "The cross-modal application's filters, on the flap's plane and the contact.",
    "the paper's planes": "The line in which the flap's first plane and each later one meet.",
    "axis": "The hinge's line, about which the flap turns.",
    "θ": "The flap's angle about the hinge.",
    "L1": "From the hand of the arm that holds the tool to the hinge.",
    "L2": "From the contact to the hinge.",
    "pad": "The curved fingertip with 12 pressure sensors that turns the flap over.",
}
