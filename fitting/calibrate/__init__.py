"""Calibration from photographs: the ball, the lights, the camera's response.

The public names, which `__init__.pyi` lists, resolve when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
