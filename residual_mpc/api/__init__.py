"""What the commands do, as functions and results; `residual_mpc` itself offers them by name."""
