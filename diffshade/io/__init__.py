"""Files in and out: images, and one foreign format a file."""
