"""Articulated objects as they are perceived, and as models that simulators read."""
