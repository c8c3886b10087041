"""Bytes in and files out: archives, pickles, tensors, glTF, atomic writes."""
