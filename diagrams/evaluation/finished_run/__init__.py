"""`crossmodal show RUN`: the page of a finished run."""
