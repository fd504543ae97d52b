"""Which sets of effects explain the runs: screening, forward steps, pruning, and rival sets."""
