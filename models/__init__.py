"""Robots, objects, textures and trained weights, as files."""

from pathlib import Path

MODELS_DIR = Path(__file__).resolve().parent
SDF_DIR = MODELS_DIR / "sdf"
WEIGHTS_DIR = MODELS_DIR / "weights"
