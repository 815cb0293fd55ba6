"""What moves: controllers that read the measured joints and wrench, never the plant's truth."""
