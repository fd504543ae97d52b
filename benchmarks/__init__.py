"""What a diagnosis costs, how often it is right, what it says of recorded robots; from the repository only."""
