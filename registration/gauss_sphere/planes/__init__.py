"""Segments of profiles, patches grown from them, planes fitted to their points."""
