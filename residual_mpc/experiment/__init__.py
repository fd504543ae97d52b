"""Which motion to drive next: one that parts what the runs so far could not."""
