"""Pictures, films, the viewer and the contact editor in a browser, report pages and pages to share."""
