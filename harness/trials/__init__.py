"""An experiment as frozen trials: views, random pairs, the points of a sweep."""
