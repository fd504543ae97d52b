"""Learning from a stream of velocities, sample after sample, in this process or in one of its own."""
