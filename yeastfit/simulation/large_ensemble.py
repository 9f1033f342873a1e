"""Ensembles of colonies whose size nobody knows beforehand: one colony on each device, each with room of its own."""

import queue
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from yeastfit.model.colony import Colony, widened
from yeastfit.model.model import Model


def on_all_devices(grow: Callable[[int], PyTree], members: int) -> list[PyTree]:
    """What `grow` returns for each member, as many at once as there are devices; whatever their number, the same."""
    free: queue.SimpleQueue[jax.Device] = queue.SimpleQueue()
    devices = jax.local_devices()[:members]
    for device in devices:
        free.put(device)

    def on_a_free_one(member: int) -> PyTree:
        device = free.get()
        try:
            with jax.default_device(device):
                return jax.tree.map(np.asarray, grow(member))
        finally:
            free.put(device)

    with ThreadPoolExecutor(len(devices)) as pool:
        return list(pool.map(on_a_free_one, range(members)))


def member_of(ensemble: PyTree, member: int) -> PyTree:
    """One member of arrays with an axis of members."""
    return jax.tree.map(itemgetter(member), ensemble)


def together(colonies: list[Colony], model: Model) -> Colony:
    """One ensemble, with room for the largest of its members."""
    room = max(colony.parents.shape[0] for colony in colonies)
    return stacked([widened(colony, room, model.node_state()) for colony in colonies])


def stacked(trees: list[PyTree]) -> PyTree:
    """Along a first axis."""
    return jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *trees)
