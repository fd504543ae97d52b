"""What no named effect explains as fitted laws: proposed from the remainder, fitted by replay, tested on folds."""
