"""Which devices a fit runs on, and how arrays come to lie there.

A mesh may span processes that `jax.distributed` has joined. All call `fit` with the same input, and
each copies to its own devices only what these need.
"""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import PyTree

from diffshade.errors import BadInput
from fitting.blocks import fingerprint

__all__ = ["AXIS", "Devices", "check_same_input", "mesh_over", "place"]

Devices = Sequence[jax.Device] | Mesh | None

AXIS = "points"


def mesh_over(devices: Devices) -> Mesh | None:
    """A mesh of one axis over the devices; None for None: one device, wherever JAX puts things."""
    if devices is None:
        return None
    if isinstance(devices, Mesh):
        if len(devices.axis_names) != 1:
            raise BadInput(
                f"devices is a mesh with the axes {devices.axis_names}: give one with a single axis, or"
                " a sequence of devices"
            )
        devices = list(devices.devices)
    given = list(devices)
    if not given or len(set(given)) < len(given):
        raise BadInput(f"devices is {given}: give one device or more, each once, or None")
    processes, joined = {device.process_index for device in given}, set(range(jax.process_count()))
    if processes not in ({jax.process_index()}, joined):
        raise BadInput(
            f"devices are those of the processes {sorted(processes)}: give devices of this process,"
            f" {jax.process_index()}, or of all {len(joined)}, as jax.devices() has them"
        )
    return Mesh(np.array(given), (AXIS,), axis_types=(AxisType.Explicit,))


def place(tree: PyTree, mesh: Mesh, specs: PyTree) -> PyTree:
    """The tree's arrays on the devices of the mesh, each as its spec says."""

    def placed(x: Any, spec: PartitionSpec) -> Any:
        host = np.asarray(x)
        sharding = NamedSharding(mesh, spec)
        return jax.make_array_from_callback(host.shape, sharding, lambda at: host[at])

    return jax.tree.map(placed, tree, specs)


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
