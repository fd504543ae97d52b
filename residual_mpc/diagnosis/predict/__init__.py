"""What the model predicts on the windows, the hypotheses that change it, and what noise alone would leave."""
