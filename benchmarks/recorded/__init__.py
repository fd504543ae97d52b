"""Diagnoses of recorded robots: gaps on held-out runs, causes, and what is known of them from elsewhere."""
