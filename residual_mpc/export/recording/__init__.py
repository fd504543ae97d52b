"""Runs as recordings for other viewers: what was measured, what the models predict, and the robot in motion."""
