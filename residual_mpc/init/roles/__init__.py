"""Which column is what: every column given to one role at most."""
