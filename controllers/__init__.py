"""LQR and MPC, one file each."""
