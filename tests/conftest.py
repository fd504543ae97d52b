"""Makes the helpers of one folder importable from another: pytest puts this file's folder on the path."""
