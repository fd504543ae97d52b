"""Known changes in a real robot's recorded runs: sealed cases for `compare`."""
