"""Run tables: read, check, resample, cut into windows."""
