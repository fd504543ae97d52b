"""Tables from files: found, recognised, read, checked and put in order."""
