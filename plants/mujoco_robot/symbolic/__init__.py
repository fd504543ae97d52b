"""The robot's one step in CasADi: rigid-body dynamics by adam-robotics, servos and effects around them."""
