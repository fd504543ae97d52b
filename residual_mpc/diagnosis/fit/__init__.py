"""Least-squares fits of hypotheses and how much their numbers can be trusted."""
