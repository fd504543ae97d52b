"""Truths of the blind benchmark, one family a module."""
