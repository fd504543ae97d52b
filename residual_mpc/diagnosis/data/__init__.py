"""Runs cut into windows: what was measured and sent, its noise, its outliers, and what is held out."""
