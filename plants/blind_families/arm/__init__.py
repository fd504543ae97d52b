"""Blind cases of serial arms of 2 to 7 hinges, drawn at random."""

from plants.blind_families.arm.family import FAMILY

__all__ = ["FAMILY"]
