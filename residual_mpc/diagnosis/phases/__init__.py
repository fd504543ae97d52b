"""The phases of a diagnosis, one file each."""
