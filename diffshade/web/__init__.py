"""The page that `diffshade view` writes: a scene to look at and to change, in any browser."""
