"""The blend from rest to rest whose jerk is least."""

PEAK_RATE = 1.875  # Largest rate of the blend.


def minimum_jerk(s: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration of the minimum-jerk blend at s in [0, 1]."""
    s = min(max(s, 0.0), 1.0)
    return (
        s**3 * (10 - 15 * s + 6 * s**2),
        s**2 * (30 - 60 * s + 30 * s**2),
        s * (60 - 180 * s + 120 * s**2),
    )
