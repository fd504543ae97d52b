"""The model with its effects, stepped: a batched replay, and a simulator for whoever wants to drive it."""
