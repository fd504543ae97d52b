"""Numbers, effects and verdicts in words that anyone understands."""
