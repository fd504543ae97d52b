"""What new runs say about a diagnosis: which of its explanations they agree with, and which they exclude."""
