"""Poses by the planes that they lay on each other, as likely as these make them."""
