"""What the words of the clutter application's tables mean."""

GLOSSARY = {
    "sampled density": (
        "The pose as a density over all that was seen and touched, which samples describe; the"
        " robot acts by this estimator."
    ),
    "TIQF": "The paper's translation-invariant quaternion filter, of points alone.",
    "target": "The known object whose pose is sought.",
    "guess": "The pose that is believed before the first view and the first touch.",
    "view": "Images that the camera takes from a place that was chosen.",
    "touch": (
        "A finger moves along a straight line until it feels something or has come to the line's"
        " end."
    ),
    "stages": "The guess, and what is believed after each view and after each touch.",
    "ADI": (
        "The mean distance from the object's surface at the true pose to that at the estimated"
        " one, so that a symmetric object may be turned."
    ),
    "as the touching arm meets it": (
        "Compared with where this arm has to go to meet the object, which its calibration's error"
        " displaces."
    ),
    "claimed 95 % region": "Where the truth should lie in 95 of 100 cases, by the estimator.",
    "in the way": (
        "What overlaps the target in the image or is nearer to it than the scenario's"
        " declutter.near, and what overlaps that."
    ),
    "grasp": "The gripper takes an object from above, lifts it and puts it down elsewhere.",
    "push": "The gripper moves an object aside along the table.",
    "where the arm meets what is seen": (
        "The arm offset: by how much the arm meets an object beside where the camera sees it,"
        " because both are calibrated with errors."
    ),
}
