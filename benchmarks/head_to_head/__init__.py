"""Head-to-head with `mujoco.sysid` on a one-joint servo that has something its model lacks."""
