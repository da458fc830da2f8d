"""Rotations from pairs of normals, and shifts that many planes agree on."""
