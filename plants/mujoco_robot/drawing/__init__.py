"""A MuJoCo robot in pictures: its skeleton, its outline from above, and its shapes by MuJoCo's renderer."""
