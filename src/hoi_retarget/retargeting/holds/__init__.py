"""Holds: one pose of a hand on an object for each episode of contact, chosen before the body is solved."""
