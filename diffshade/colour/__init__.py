"""Colour after shading: systems of colour, the way between colours, and screens of few intensities."""
