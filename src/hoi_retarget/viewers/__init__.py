"""What people look at: pictures, video, the viewer and the contact editor in a browser, pages to share."""
