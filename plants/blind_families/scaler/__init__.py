"""Blind cases of the SCALER arm of the paper."""

from plants.blind_families.scaler.family import FAMILY

__all__ = ["FAMILY"]
