"""Puts models as they are found in the wild into a form that the simulation takes."""

MODEL_FILE = "object.sdf"
COPIED_FOLDERS = ("meshes", "textures")  # Beside it.
