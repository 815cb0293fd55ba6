"""What the words of the clutter application's tables mean."""

GLOSSARY = {
    "sampled density": (
        "The pose as a density over all that was seen and touched, which samples describe; the"
        " robot acts by this estimator."
    ),
    "TIQF": "The paper's translation-invariant quaternion filter, of points alone.",
    "ADI": (
        "The mean distance from the object's surface at the true pose to that at the estimated"
        " one, so that a symmetric object may be turned."
    ),
    "claimed 95 % region": "Where the truth should lie in 95 of 100 cases, by the estimator.",
}
