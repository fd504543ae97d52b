"""The sequential test: windows scored against a reference, cumulative sums of the scores, calibrated thresholds."""
