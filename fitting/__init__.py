"""Material fitting: from images of known surfaces under known lights to coefficients and their errors.

The public names, which `__init__.pyi` lists, resolve when they are first used: importing the package
alone costs nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
