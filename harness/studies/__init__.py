"""What the accuracy depends on, with a conclusion."""
