"""Simple methods to compare with, behind the same options and the same output as a diagnosis."""
