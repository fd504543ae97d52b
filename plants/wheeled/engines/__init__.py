"""The robot as MJCF and URDF, and in motion in MuJoCo and in PyBullet."""
