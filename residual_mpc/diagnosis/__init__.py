"""Gap, where, which, how far, unknown: diagnose() runs them in order."""
