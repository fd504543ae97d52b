"""What changed between two sets of runs of one robot."""
