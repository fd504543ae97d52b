"""Diagnoses the gap between a robot's model and its logged runs."""
