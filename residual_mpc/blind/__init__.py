"""Make, seal, score: the benchmark whose answers are withheld."""
