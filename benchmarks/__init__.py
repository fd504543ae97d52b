"""What a diagnosis costs, how often it is right, and what it says of recorded robots."""
