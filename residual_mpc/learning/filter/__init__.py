"""Kalman filters over the weights of a network: UKF and EKF, and what they share."""
