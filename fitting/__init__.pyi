from .estimate import Fit as Fit
from .estimate import fit as fit
from .residual import Evaluation as Evaluation
from .residual import evaluate as evaluate
