"""A corrected robot in the forms that other tools read: URDF, a parameter set of mujoco.sysid, a table of actuators."""
