"""Arms of hinges and slides in machine code that is made for each of them: MuJoCo's steps, several rows at once."""
