"""What is known of each column of a log before it has a role: its name, its values, and how it follows others."""
