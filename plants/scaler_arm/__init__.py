"""The SCALER arm: shoulder, five-bar linkage and spherical wrist, six motors and a closed loop."""
