"""Where faces end, and what a view says of ends that the other one saw."""
