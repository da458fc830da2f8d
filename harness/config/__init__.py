"""What an experiment's file may say, read and checked."""
