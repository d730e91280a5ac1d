"""That all processes which make one fit together were given the same."""

import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh
from jaxtyping import PyTree

from diffshade.errors import BadInput
from fitting.blocks import fingerprint

__all__ = ["check_same_input"]


def check_same_input(mesh: Mesh | None, options: str, *inputs: PyTree) -> None:
    """Refuse, in every process alike, a fit whose processes were not all given the same."""
    if mesh is None or not mesh.is_multi_process:
        return
    named = np.frombuffer(options.encode(), np.uint8)
    digest = np.frombuffer(bytes.fromhex(fingerprint(named, *inputs)), np.uint8)
    digests = np.asarray(multihost_utils.process_allgather(digest)).reshape(-1, digest.size)
    other = np.flatnonzero((digests != digests[0]).any(axis=1))
    if other.size:
        raise BadInput(
            f"process {other[0]} was given other images, surfaces, scenes or options than process 0:"
            " give all the same"
        )
