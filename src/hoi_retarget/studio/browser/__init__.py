"""The viewer and the contact editor in a browser."""
