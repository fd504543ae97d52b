"""What no named effect explains, learned from minutes of data: an MLP whose weights a Kalman filter updates online."""
