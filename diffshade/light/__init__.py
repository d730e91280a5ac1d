"""Sources of light, one kind a file, and how their intensity falls with distance."""
