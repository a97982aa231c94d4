"""How right an inserted thing is: two generated objects on a ground, path-traced with and without the second."""
