"""Images of phones and cameras: names, EXIF times, focal lengths and positions."""
