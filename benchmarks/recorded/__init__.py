"""Diagnoses of recorded robots: gaps on runs kept back, causes, and what is known of them from elsewhere."""
