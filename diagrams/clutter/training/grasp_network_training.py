"""Makes the views that the grasp network learns from, trains it and writes weights and card."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crossmodal.diagrams.clutter.training.grasp_data import (
    Sample,
    draw_samples,
    lowered,
    observe,
    standing,
)
from crossmodal.diagrams.clutter.training.grasp_labels import find_contacts, find_grasps
from crossmodal.diagrams.clutter.training.grasp_lift import simulate_lift
from crossmodal.diagrams.clutter.training.grasp_training import View, export
from crossmodal.diagrams.clutter.training.shapes import GOODS, goods
from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.evaluation.campaign_report import made_by
from crossmodal.diagrams.run.folder.written_files import write_atomically, write_text
from crossmodal.diagrams.run.process import ending_with_this_process
from crossmodal.maths.arrays import Array
from crossmodal.systems.grasping.grasp_geometry import is_blocked
from crossmodal.systems.grasping.grasp_planner import (
    GraspPlannerConfig,
    load_grasp_network,
    plan_grasps,
)
from crossmodal.systems.onnx_network import OnnxNetwork
from crossmodal.systems.sensors.randomness import make_generator

FILES = ("grasp.onnx", "grasp.md")  # Weights and card.
SCENES = 25  # In a file of data.
_QUALITIES = (0.3, 0.7)  # From which on grasps are counted.
_POSES = 4  # Of each of the goods in which lifts are simulated.
_HELD_OUT = 8  # Of so many files the last one is not learned from.


def make_data(folder: Path, files: int, seed: int, jobs: int) -> Iterator[Path]:
    """Yields the files of views in their order; those that are there already are left alone."""
    from joblib import Parallel, delayed

    paths = [folder / f"grasp-{seed}-{number:04d}.npz" for number in range(files)]
    one = delayed(ending_with_this_process(_make_file))
    yield from Parallel(n_jobs=jobs, return_as="generator")(
        one(path, number, seed) for number, path in enumerate(paths)
    )


def _make_file(path: Path, number: int, seed: int) -> Path:
    if path.is_file():
        return path
    scenes = range(SCENES * number, SCENES * (number + 1))
    samples = [sample for scene in scenes for sample in draw_samples(seed, scene)]
    return save_views(path, [view_of(sample) for sample in samples])


def save_views(path: Path, views: Sequence[View]) -> Path:
    """Writes a file that `load_views` reads, with heights of half precision."""
    arrays: dict[str, Any] = {
        "heights": np.array([view.heights for view in views], np.float16),
        "counts": np.array([len(view.grasps) for view in views]),
        "grasps": np.concatenate([view.grasps for view in views]).astype(np.float32),
        "liking": np.concatenate([view.liking for view in views]).astype(np.float32),
    }

    def save(place: Path) -> None:
        with place.open("wb") as file:
            np.savez_compressed(file, **arrays)

    return write_atomically(path, save)


def view_of(sample: Sample) -> View:
    """What the network learns from a sample."""
    cells = sample.view.cells(sample.grasps[:, :2])
    return View(
        heights=sample.view.heights,
        grasps=np.column_stack([cells, sample.grasps[:, 2:4]]),
        liking=sample.liking,
    )


def load_views(path: Path) -> list[View]:
    """Of one file."""
    with np.load(path) as file:
        heights, counts = file["heights"].astype(np.float32), file["counts"]
        grasps, liking = file["grasps"].astype(float), file["liking"].astype(float)
    ends = np.cumsum(counts)
    return [
        View(heights=h, grasps=grasps[end - n : end], liking=liking[end - n : end])
        for h, n, end in zip(heights, counts, ends, strict=True)
    ]


def seen_files(paths: Sequence[Path]) -> list[Path]:
    """Those of the files in their order that are learned from."""
    return [path for number, path in enumerate(paths) if not _is_held_out(number)]


def _is_held_out(number: int) -> bool:
    return number % _HELD_OUT == _HELD_OUT - 1


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What becomes of the best planned grasp of a view.

    Attributes:
        name: Of the goods, empty for others.
        alone: Whether it is the only object.
        graspable: Whether there is a grasp that holds and is free.
        quality: Of the best planned grasp, zero without one.
        holds: Whether that holds and is free, by geometry.
    """

    name: str
    alone: bool
    graspable: bool
    quality: float
    holds: bool


def holds_and_is_free(sample: Sample, grasp: Array) -> bool:
    """Whether a grasp (5,) holds and its fingers come down on nothing, by geometry."""
    body = sample.body
    contacts = find_contacts(body.shape, body.corners, body.p_WCm, grasp[None])
    heights = np.maximum(sample.heights, sample.others)
    return bool(contacts.holds[0] and not is_blocked(heights, grasp[None], sample.view)[0])


def judge(sample: Sample, network: OnnxNetwork, config: GraspPlannerConfig) -> Verdict:
    """Plans the grasps of a sample and looks whether the best one is good."""
    planned, quality = plan_grasps(sample.view, network, config)
    return Verdict(
        name=sample.name,
        alone=sample.alone,
        graspable=not is_blocked(sample.others, sample.grasps, sample.view).all(),
        quality=float(quality[0]) if len(quality) else 0.0,
        holds=len(planned) > 0 and holds_and_is_free(sample, planned[0]),
    )


def held_out_scenes(files: int) -> list[int]:
    """Scenes that are for testing alone."""
    return [
        scene
        for number in range(files)
        if _is_held_out(number)
        for scene in range(SCENES * number, SCENES * (number + 1))
    ]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A simulated lift of a good that is alone.

    Attributes:
        name: Of the goods.
        planned: Whether it is the best planned grasp, or one at a random place and angle.
        holds: By geometry.
        held: In the simulation.
    """

    name: str
    planned: bool
    holds: bool
    held: bool


def lift_goods(
    network: OnnxNetwork, config: GraspPlannerConfig, poses: int, seed: int
) -> Iterator[list[Trial]]:
    """Yields for each of the goods what becomes of the best grasp, and of a random one, by pose."""
    for name in GOODS:
        trials = []
        for pose in range(poses):
            rng, shape = make_generator(seed, f"grasp lift {name}", pose), goods(name)
            for sample in observe([lowered(shape, standing(shape, rng), np.zeros(2), [])], rng):
                grasps, _ = plan_grasps(sample.view, network, config)
                any_grasp = touches(sample, rng)
                chosen = [(True, grasps[:1]), (False, any_grasp[:1])]
                for planned, grasp in [(p, row) for p, rows in chosen for row in rows]:
                    lift = simulate_lift(name, sample.body.X_WO, grasp)
                    holds = holds_and_is_free(sample, grasp)
                    trials.append(Trial(name=name, planned=planned, holds=holds, held=lift.held))
        yield trials


def touches(sample: Sample, rng: np.random.Generator) -> Array:
    """Grasps (N, 5) at random places and angles at which both fingers meet the object."""
    body = sample.body
    grasps, _ = find_grasps(
        body.shape, body.corners, body.p_WCm, sample.view, sample.heights, 50, rng, holding=False
    )
    return rng.permutation(grasps)


def write_grasp(
    network: Any, folder: Path, seed: int, files: int, epochs: int, views: int
) -> tuple[list[Path], str]:
    """Scores a network on scenes that it has not seen, and writes it and its card.

    Returns:
        The files written, and the card.
    """
    path = write_atomically(folder / FILES[0], lambda place: export(network, place))
    config = GraspPlannerConfig(weights=str(path.resolve()))
    reader = load_grasp_network(config)
    scenes = held_out_scenes(files)
    verdicts = [judge(s, reader, config) for k in scenes for s in draw_samples(seed, k)]
    trials = [trial for ts in lift_goods(reader, config, _POSES, seed) for trial in ts]
    command = f"crossmodal train grasp --seed {seed} --files {files} --epochs {epochs}"
    card = grasp_card(verdicts, trials, made_by(command), views)
    return [path, write_text(folder / FILES[1], card)], card


def grasp_card(
    verdicts: Sequence[Verdict], trials: Sequence[Trial], command: str, views: int
) -> str:
    """What the network learned from and how good its grasps are, in Markdown."""
    lines = [
        "# Grasps: GG-CNN on heights above the table",
        "",
        f"- data: {views} views of the goods, of stretched goods and of random shapes, alone and in"
        " heaps, by a depth camera with faults; grasps by geometry and statics on the true meshes",
        f"- split: one in {_HELD_OUT} files, of {SCENES} scenes each, is not learned from:"
        f" {len(verdicts)} views",
        "- metric: share of the views, of objects that can be grasped, whose best planned grasp"
        " holds and is free by the same geometry",
        f"- command: {command}",
        "",
    ]
    table = Table(
        header=["views not learned from", "views", "graspable", "best grasp holds"]
        + [f"planned at quality >= {q}" for q in _QUALITIES]
        + [f"of these hold, >= {q}" for q in _QUALITIES]
    )
    groups: dict[str, list[Verdict]] = {
        "all": list(verdicts),
        "goods": [v for v in verdicts if v.name],
        "goods alone": [v for v in verdicts if v.name and v.alone],
        "goods in heaps": [v for v in verdicts if v.name and not v.alone],
        "other shapes": [v for v in verdicts if not v.name],
    }
    groups |= {name: [v for v in verdicts if v.name == name] for name in GOODS}
    for title, ours in groups.items():
        able = [v for v in ours if v.graspable]
        planned = [[v for v in ours if v.quality >= q] for q in _QUALITIES]
        table.rows.append(
            [title, str(len(ours)), str(len(able)), _share([v.holds for v in able])]
            + [str(len(vs)) for vs in planned]
            + [_share([v.holds for v in vs]) for vs in planned]
        )
    lines += [table.markdown(), ""]
    lifts = Table(
        header=[
            "simulated lifts, goods alone",
            "lifts",
            "held",
            "geometry agrees",
            "held of those that hold by geometry",
            "held of the others",
        ]
    )
    parts = {
        "best planned grasp": [t for t in trials if t.planned],
        "random place and angle": [t for t in trials if not t.planned],
    }
    parts |= {name: [t for t in trials if t.planned and t.name == name] for name in GOODS}
    for title, these in parts.items():
        lifts.rows.append(
            [
                title,
                str(len(these)),
                _share([t.held for t in these]),
                _share([t.held == t.holds for t in these]),
                _share([t.held for t in these if t.holds]),
                _share([t.held for t in these if not t.holds]),
            ]
        )
    return "\n".join([*lines, lifts.markdown(), ""])


def _share(found: Sequence[bool]) -> str:
    return f"{100.0 * np.mean(found):.0f} %" if found else "-"
