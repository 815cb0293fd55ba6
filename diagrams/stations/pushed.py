"""Disturbances of scenarios in which somebody pushes things."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.diagrams.run import scenario as base
from crossmodal.plants.external_forces import ExternalForce


@dataclass(kw_only=True)
class Disturbances(base.Disturbances):
    """What goes wrong, and when."""

    forces: list[ExternalForce] = field(default_factory=list)  # From outside.

    def spans(self) -> list[tuple[str, base.Interval]]:
        """What goes wrong, in words, and when."""
        forces = [
            (
                f"{np.linalg.norm(force.force):.3g} N on {force.frame}",
                base.Interval(start=force.start, end=force.end),
            )
            for force in self.forces
        ]
        return [*super().spans(), *forces]
