"""Where a results folder keeps what the report shows in 3D; the rest of it brings much more."""

FOLDER = "pairs"
