"""A motion as a robot would have to perform it: the scene that a simulator loads, and the forces that it takes."""
