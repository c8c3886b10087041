"""The contact editor: a page that plays and changes, and the work behind it."""
