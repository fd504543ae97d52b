"""The network: its layers, the record of a learned residual with its units, and how sure it is of its output."""
