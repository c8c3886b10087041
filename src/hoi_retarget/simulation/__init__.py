"""A motion performed by a simulated robot: scene, refinement by sampling, certificate and training task."""
