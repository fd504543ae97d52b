"""Blind cases of a robot that steers by skidding on four wheels."""

from plants.blind_families.skid.family import FAMILY

__all__ = ["FAMILY"]
