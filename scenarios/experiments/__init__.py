"""The paper's nine experiments: what a network learns of a robot's velocities, online, from minutes of data."""
