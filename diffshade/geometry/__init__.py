"""Surfaces, cameras, and the G-buffer that one makes of the other."""
