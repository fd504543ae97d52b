"""Tests of a diagnosis on new runs: which of its explanations they support and which they exclude."""
