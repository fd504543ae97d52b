"""The kinds of known changes, and the library of them."""
