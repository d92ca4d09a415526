"""A page in the browser: upload, animate, look at it from all sides, download."""
