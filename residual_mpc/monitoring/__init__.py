"""Follows logs as they arrive and says when the gap of a model has changed for certain, and which effect changed."""
