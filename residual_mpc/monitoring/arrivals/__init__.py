"""Logs as they arrive: growing text, files that appear, a pipe; their rows as segments of runs."""
