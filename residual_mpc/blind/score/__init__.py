"""From diagnoses and revealed answers to figures."""
