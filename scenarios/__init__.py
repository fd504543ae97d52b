"""Closed-loop experiments, one runnable file each."""
