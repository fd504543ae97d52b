"""What `compare` said of sealed cases of recorded runs, against their answers."""
