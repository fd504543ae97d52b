"""Robots: the models that a log is compared with; the only home of MuJoCo and PyBullet."""
