"""Recordings of real robots: what is in them, and how a robot's estimators perceive them."""
