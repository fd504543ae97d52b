"""Effects and retuned parameters in the model's own numbers, and how large they may be."""
