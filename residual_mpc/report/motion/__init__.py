"""The robot in a window, filmed: its measured, predicted and corrected motion laid over each other."""
