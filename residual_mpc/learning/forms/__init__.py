"""The equations that a residual enters, and a robot with one."""
