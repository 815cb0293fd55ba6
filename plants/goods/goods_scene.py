"""Goods on a table, free to move, in a plant of their own."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.geometry import QueryObject, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from crossmodal.maths.arrays import Array
from crossmodal.models import SDF_DIR
from crossmodal.plants.parsing import add_model, make_parser

GOODS_DIR = SDF_DIR / "goods"
# Contact as in the plant in which robots work: what rests here rests there.
_AS_AT_WORK = MultibodyPlantConfig(
    time_step=0.005, discrete_contact_approximation="lagged", stiction_tolerance=1e-4
)
# What friction holds creeps a hundred times as fast: what comes to rest here hardly creeps there.
_HASTY = MultibodyPlantConfig(
    time_step=0.005, discrete_contact_approximation="lagged", stiction_tolerance=1e-2
)


class GoodsScene:
    """Goods on a table, and where they are.

    Frames: W is on the table's top, z up; O is an object's.

    Attributes:
        plant: The goods and the table.
        scene_graph: Their geometry.
        diagram: Of both.
        context: Of the diagram.
        p_WTable: Where the middle of the table's top is (3,), [m].
        bodies: One of each object, by its name.

    Args:
        names: Of models in models/sdf/goods.
        p_WTable: Where the middle of the table's top is (3,), [m].
        hasty: Whether what friction holds creeps a hundred times as fast.

    Raises:
        ValueError: for a name that is not known, or given twice.
    """

    def __init__(self, names: Sequence[str], p_WTable: Array, hasty: bool = False) -> None:
        known = sorted(folder.name for folder in GOODS_DIR.iterdir() if folder.is_dir())
        for name in names:
            if name not in known:
                raise ValueError(f"no goods named '{name}'; there are {', '.join(known)}")
        self.p_WTable = p_WTable
        builder = DiagramBuilder()
        self.plant: MultibodyPlant
        self.scene_graph: SceneGraph
        plant = _HASTY if hasty else _AS_AT_WORK
        self.plant, self.scene_graph = AddMultibodyPlant(plant, builder)
        parser = make_parser(self.plant)
        table = add_model(parser, SDF_DIR / "work_table.sdf", "table")
        self.plant.WeldFrames(
            self.plant.world_frame(),
            self.plant.GetFrameByName("table", table),
            RigidTransform(p_WTable),
        )
        models = {name: add_model(parser, GOODS_DIR / name / f"{name}.sdf", name) for name in names}
        self.plant.Finalize()
        self.bodies: dict[str, RigidBody] = {
            name: self.plant.get_body(self.plant.GetBodyIndices(model)[0])
            for name, model in models.items()
        }
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self._simulator = Simulator(self.diagram, self.context)

    @property
    def plant_context(self) -> Context:
        """The plant's part of the context."""
        return self.plant.GetMyMutableContextFromRoot(self.context)

    def query(self) -> QueryObject:
        """What the geometry answers, at these poses."""
        return self.scene_graph.get_query_output_port().Eval(
            self.scene_graph.GetMyContextFromRoot(self.context)
        )

    def poses(self) -> dict[str, RigidTransform]:
        """X_WO of each object."""
        context = self.plant_context
        return {name: body.EvalPoseInWorld(context) for name, body in self.bodies.items()}

    def place(self, poses: Mapping[str, RigidTransform]) -> None:
        """Gives each object that is named its pose X_WO; all are at rest."""
        self.plant.SetVelocities(self.plant_context, np.zeros(self.plant.num_velocities()))
        for name, X_WO in poses.items():
            self.plant.SetFloatingBaseBodyPoseInWorldFrame(
                self.plant_context, self.bodies[name], X_WO
            )

    def damp(self, rate: float) -> None:
        """Slows all objects down at a rate, [1/s]; the solver has it, so that it is stable."""
        for body in self.bodies.values():
            (index,) = self.plant.GetJointIndices(body.model_instance())
            inertia = body.default_spatial_inertia().CopyToFullMatrix6()
            turning = np.full(3, np.trace(inertia[:3, :3]) / 3.0)
            self.plant.get_joint(index).SetDampingVector(
                self.plant_context, rate * np.concatenate([turning, np.diag(inertia)[3:]])
            )

    def advance(self, seconds: float) -> None:
        """Simulates so long, [s]."""
        self._simulator.AdvanceTo(self.context.get_time() + seconds)

    def distances(self, up_to: float) -> dict[tuple[str, str], float]:
        """Signed distance of each pair of objects that is nearer than that, [m]."""
        query = self.query()
        inspector = query.inspector()
        owners = {
            self.plant.GetBodyFrameIdOrThrow(body.index()): name
            for name, body in self.bodies.items()
        }
        found: dict[tuple[str, str], float] = {}
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(up_to):
            a, b = (owners.get(inspector.GetFrameId(id)) for id in (pair.id_A, pair.id_B))
            if a is not None and b is not None:
                key = (min(a, b), max(a, b))
                found[key] = min(found.get(key, np.inf), float(pair.distance))
        return found
