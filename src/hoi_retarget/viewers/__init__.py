"""Pictures, films, the viewer and the contact editor in a browser, and pages to share."""
