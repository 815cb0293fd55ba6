"""The commands of `crossmodal`, one a module; each imports what it needs when it runs."""
