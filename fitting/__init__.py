"""Material fitting: from images of known surfaces under known lights to coefficients and their errors.

Names resolve when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fitting.estimate import Fit as Fit
    from fitting.estimate import fit as fit
    from fitting.residual import Evaluation as Evaluation
    from fitting.residual import evaluate as evaluate

_HOME = {"Evaluation": "residual", "Fit": "estimate", "evaluate": "residual", "fit": "estimate"}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'fitting' has no attribute {name!r}")
    value = getattr(import_module(f"fitting.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
