"""Objects: their pose over time, their geometry and their surface."""
