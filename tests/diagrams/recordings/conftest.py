"""Lets the tests of this folder import the messages of the tests of `systems/recordings`."""

import sys
from pathlib import Path

sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[2] / "systems/recordings")]
