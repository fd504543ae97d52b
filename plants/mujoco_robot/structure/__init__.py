"""The record of a compiled robot and its parts."""
