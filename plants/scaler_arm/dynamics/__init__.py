"""How the arm moves under its servos, without a physics engine; for any array library."""
