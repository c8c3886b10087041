"""What a robot-motion file is, from its numbers alone, and what contradicts what it claims."""
