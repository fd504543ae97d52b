"""What no named effect explains: learned, located, and described."""
