"""The human: skeleton, poses, body model, stance."""
