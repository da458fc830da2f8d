"""All of an experiment on one page."""
