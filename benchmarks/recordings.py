"""Time and memory of replaying a recording of a colour and depth camera, by its length.

It writes two bags of moving, textured images of 640 x 480 pixels, the second one twice as long, and
lets vision perceive each in a process of its own. 46 MB a second are written to the temporary
folder, and removed again.

    python -m benchmarks.recordings --seconds 10
"""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Annotated

import cv2
import numpy as np
import typer

from crossmodal.diagrams.recordings.calibration_file import RecordedCamera, RecordedRobot
from crossmodal.diagrams.recordings.replay_recording import prepare
from crossmodal.diagrams.recordings.survey import survey
from crossmodal.diagrams.recordings.topic_map import TopicMap
from crossmodal.diagrams.run.process import peak_memory
from crossmodal.systems.recordings.bag_writer import BagWriter
from crossmodal.systems.recordings.images import IMAGE

WIDTH, HEIGHT, FOCAL = 640, 480, 525.0  # [px]
COLOR, DEPTH = "/color/image", "/depth/image"
WALL, BOX = 1.2, 0.9  # How far away they are, [m].
_START = 1_700_000_000  # [s]


def textured(rng: np.random.Generator) -> np.ndarray:
    """An image (H, W, 3) with corners of several sizes."""
    layers = [
        cv2.resize(rng.uniform(0.0, 255.0, (h, 4 * h // 3, 3)), (WIDTH, HEIGHT))
        for h in (30, 60, 120)
    ]
    return np.mean(layers, axis=0).astype(np.uint8)


def write_recording(path: Path, seconds: float, rate: float) -> None:
    """A box that slides to and fro by 10 cm in front of a wall, at a rate [Hz]."""
    rng = np.random.default_rng(0)
    wall, box = textured(rng), textured(rng)
    noise = rng.normal(0.0, 2e-3, size=(HEIGHT, WIDTH))  # [m]
    inside = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    inside[140:340, 220:420] = 1
    with BagWriter(path, "mcap") as writer:
        for k in range(int(seconds * rate) + 1):
            t = k / rate
            shift = 0.1 * np.sin(t) * FOCAL / BOX
            moved = np.array([[1.0, 0.0, shift], [0.0, 1.0, 0.0]])
            front = cv2.warpAffine(inside, moved, (WIDTH, HEIGHT), flags=cv2.INTER_NEAREST) > 0
            pixels = np.where(front[:, :, None], cv2.warpAffine(box, moved, (WIDTH, HEIGHT)), wall)
            depth = np.where(front, BOX, WALL) + np.roll(noise, 17 * k, axis=1)
            nanoseconds = _START * 10**9 + round(1e9 * t)
            for topic, image, encoding in (
                (COLOR, pixels, "bgr8"),
                (DEPTH, (1e3 * depth).astype(np.uint16), "16UC1"),
            ):
                fields = {
                    "header": {"stamp": {"sec": _START + int(t), "nanosec": nanoseconds % 10**9}},
                    "height": HEIGHT,
                    "width": WIDTH,
                    "encoding": encoding,
                    "step": image.strides[0],
                    "data": image.tobytes(),
                }
                writer.write(topic, IMAGE, fields, nanoseconds)


def measured(path: Path) -> tuple[float, float, float, int, int]:
    """Of reading it once and then perceiving: recorded, wall and processor time, [s].

    Moving bodies at the end, and peak memory, [B].
    """
    camera = RecordedCamera(
        width=WIDTH, height=HEIGHT, focal_x=FOCAL, center_x=319.5, center_y=239.5
    )
    began, used = perf_counter(), process_time()
    found = survey(path)
    wall, cpu = perf_counter() - began, process_time() - used
    ready = prepare(found, TopicMap(color=COLOR, depth=DEPTH), RecordedRobot(camera=camera))
    used = process_time()
    record = ready.run(None, None)  # Its wall time is without building; processor time has it.
    wall, cpu = wall + record.wall_time, cpu + process_time() - used
    bodies = record.estimators["vision"].ticks[-1].values["body_motions_latest"].bodies
    return record.duration, wall, cpu, len(bodies), peak_memory()


def main(
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of the shorter one.")] = 10.0,
    rate: Annotated[float, typer.Option(min=1.0, help="Images per second.")] = 30.0,
) -> None:
    """Prints the table."""
    print("| recorded s | wall time per recorded | of a core | moving bodies | memory GB |")
    print("|---|---|---|---|---|")
    for length in (seconds, 2.0 * seconds):
        with TemporaryDirectory() as folder:
            path = Path(folder, "moving")
            write_recording(path, length, rate)
            fresh = multiprocessing.get_context("spawn")  # Whose peak memory is its own.
            with ProcessPoolExecutor(1, mp_context=fresh) as pool:
                duration, wall, cpu, bodies, memory = pool.submit(measured, path).result()
        shares = f"{wall / duration:.2f} | {cpu / duration:.2f}"
        print(f"| {duration:.0f} | {shares} | {bodies} | {1e-9 * memory:.2f} |", flush=True)


if __name__ == "__main__":
    typer.run(main)
