"""The planner of what to take away: the declutter graph of each new image."""

from dataclasses import replace
from typing import Any

import shapely
from pydrake.systems.framework import Context

from crossmodal.maths.validation import check
from crossmodal.systems.declutter.declutter_graph import DeclutterConfig, declutter_graph
from crossmodal.systems.declutter.fingers import grasps_left
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_GRASPS,
    NO_SEGMENTS,
    NO_TRIES,
    DeclutterGraph,
    Grasps,
    Segments,
    Tries,
)
from crossmodal.systems.recursive_filter import RecursiveFilter


class DeclutterPlanner(RecursiveFilter):
    """Makes the declutter graph whenever a new image has been segmented.

    Once the target was seen, it is the root of all graphs to come: where it was, if it is hidden.
    Before, the root is in the middle of the largest heap, where it may be.

    Input ports:
    - `segments`: `Segments`, all objects in the last image, whose number tells that it is new;
      places in W, [m].
    - `grasps`: `Grasps` of an image, each quality clipped to 0 to 1; the graph waits for those of
      its own image. May stay unconnected, then nothing can be grasped.
    - `tries`: `Tries`, how often which action has failed on which object; the graph waits for those
      that were counted up to its image. May stay unconnected, then none has.

    Output ports:
    - `declutter_graph`: `DeclutterGraph` of the last tick, from the state alone; `NO_GRAPH` before
      the first image.
    """

    def __init__(
        self,
        target: str,
        config: DeclutterConfig,
        period: float,
        table: shapely.Geometry | None = None,
    ) -> None:
        """Makes the planner.

        Args:
            target: Name of the target's class.
            config: Of the graph.
            period: Of the ticks, [s].
            table: The part of it to which objects may be pushed, in W; None for anywhere.

        Raises:
            ValueError: for an impossible configuration, and where the target has no name.
        """
        super().__init__()
        check(config, "DeclutterPlanner")
        if not target:
            raise ValueError("DeclutterPlanner: target = '', but it must be the name of a class")
        self._target, self._config, self._table = target, config, table
        self._segments = self._declare_value_input("segments", NO_SEGMENTS)
        self._grasps = self._declare_value_input("grasps", NO_GRASPS)
        self._tries = self._declare_value_input("tries", NO_TRIES)
        self._declare_recursion(NO_GRAPH, self._calc, period)
        self._declare_latest("declutter_graph", lambda graph: graph)

    def _calc(self, context: Context, graph: Any) -> DeclutterGraph:
        before: DeclutterGraph = graph
        scene: Segments = self._read(self._segments, context)
        found: Grasps | None = self._read_optional(self._grasps, context)
        tries: Tries | None = self._read_optional(self._tries, context)
        waits = any(of is not None and of.number != scene.number for of in (found, tries))
        if scene.number == before.number or waits:
            return before
        failed = tries or NO_TRIES
        grasps = replace(found or NO_GRASPS, grasps=grasps_left(found or NO_GRASPS, failed))
        qualities = {number: grasps.best(number) for number in grasps.grasps}
        seen = before.vertices and not before.is_guess
        remembered = before.vertices[0].segment if seen else None
        return declutter_graph(
            scene, self._target, qualities, failed, self._config, remembered, self._table
        )
