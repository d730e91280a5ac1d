"""Which devices pixels are dealt out over, and how arrays come to lie there.

A mesh may span processes that `jax.distributed` has joined. All are given the same, and each copies
to its own devices only what these need.
"""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import PyTree

from diffshade.errors import BadInput

__all__ = ["AXIS", "Devices", "dealt", "mesh_over", "place"]

Devices = Sequence[jax.Device] | Mesh

AXIS = "points"


def mesh_over(devices: Devices) -> Mesh:
    """A mesh of one axis over the devices.

    XLA lays out what stands outside of `shard_map` by itself (`AxisType.Auto`).
    """
    if isinstance(devices, Mesh):
        if len(devices.axis_names) != 1:
            raise BadInput(
                f"devices is a mesh with the axes {devices.axis_names}: give one with a single axis, or"
                " a sequence of devices"
            )
        devices = list(devices.devices)
    if not isinstance(devices, Sequence | np.ndarray):
        raise BadInput(f"devices is {devices!r}: give a sequence of devices, such as jax.devices()")
    given = list(devices)
    if not given or len(set(given)) < len(given):
        raise BadInput(f"devices is {given}: give one device or more, each once")
    processes, joined = {device.process_index for device in given}, set(range(jax.process_count()))
    if processes not in ({jax.process_index()}, joined):
        raise BadInput(
            f"devices are those of the processes {sorted(processes)}: give devices of this process,"
            f" {jax.process_index()}, or of all {len(joined)}, as jax.devices() has them"
        )
    return Mesh(np.array(given), (AXIS,), axis_types=(AxisType.Auto,))


def dealt(tree: PyTree, planes: PyTree) -> PyTree:
    """How a tree is dealt out: by its last axis where `planes`, a tree like it, says so."""

    def spec(x: Any, plane: bool) -> PartitionSpec:
        return PartitionSpec(*(None,) * (np.ndim(x) - 1), AXIS) if plane else PartitionSpec()

    return jax.tree.map(spec, tree, planes)


def place(tree: PyTree, mesh: Mesh, specs: PyTree) -> PyTree:
    """The tree's arrays on the devices of the mesh, each as its spec says."""

    def placed(x: Any, spec: PartitionSpec) -> Any:
        host = np.asarray(x)
        sharding = NamedSharding(mesh, spec)
        return jax.make_array_from_callback(host.shape, sharding, lambda at: host[at])

    return jax.tree.map(placed, tree, specs)
