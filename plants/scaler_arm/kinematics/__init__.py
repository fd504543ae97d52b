"""Where the links are: geometry, forward and inverse kinematics, the closed five-bar loop."""
