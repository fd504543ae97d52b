"""Learning from recorded runs: windows, updates, the choice among passes, and the evaluation."""
