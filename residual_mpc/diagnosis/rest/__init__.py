"""What the named effects leave: where it sits, what it depends on, its shape, and which known effect it resembles."""
