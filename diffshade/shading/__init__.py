"""Where surfaces, lights and materials meet: the basis of an image, and its contraction."""
