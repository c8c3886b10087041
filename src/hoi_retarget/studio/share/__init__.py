"""Pages that play results without a server."""
