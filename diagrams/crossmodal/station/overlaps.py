"""What of a scene is inside something else before anything moves."""

from crossmodal.diagrams.crossmodal.station.station import ManipulationStation

_DEEPEST_OVERLAP = 0.005  # [m]


def overlaps(station: ManipulationStation) -> list[str]:
    """What of an object is inside something else at the start, by more than 5 mm, a line each."""
    scene, context = station.scene, station.diagram.CreateDefaultContext()
    station.SetInitialState(context)
    query = scene.scene_graph.get_query_output_port().Eval(
        scene.scene_graph.GetMyContextFromRoot(context)
    )
    objects = list(scene.objects.values())
    inspector, deepest = query.inspector(), dict[tuple[str, str], float]()
    for pair in query.ComputePointPairPenetration():
        bodies = [
            scene.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            for geometry in (pair.id_A, pair.id_B)
        ]
        bodies.sort(key=lambda body: body.model_instance() not in objects)
        if bodies[0].model_instance() in objects and pair.depth > _DEEPEST_OVERLAP:
            names = bodies[0].name(), bodies[1].name()
            deepest[names] = max(deepest.get(names, 0.0), pair.depth)
    return [
        f"link '{link}' starts {100 * depth:.0f} cm inside '{other}'; place the object elsewhere"
        " (objects.NAME.position)"
        for (link, other), depth in deepest.items()
    ]
