"""An episode that is watched in Meshcat while it runs: its buttons and sliders."""
