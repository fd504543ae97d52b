"""From a model file to a compiled model."""
