"""Blind cases of a robot on two driven wheels."""

from plants.blind_families.wheeled.family import FAMILY

__all__ = ["FAMILY"]
